"""True poses of one vehicle, for an on-board sensor of another.

They replace the waves of the sensor: no link impairs them, and only the emulation uses them.
"""

from collections import deque
from typing import cast

from transport.codec import RefusedMessageError, decode
from transport.topics import TOPICS, key
from vehicles.messages import TruePose

TRUTH = TOPICS["truth"]
KEPT = 128  # Number of poses kept, two seconds of them: more than the latency of a sensor


class TruePoses:
    """Collects the true poses of `vehicle`.

    `late` counts poses that arrived after they were needed, and `refused` messages that are none.
    """

    def __init__(self, vehicle: str) -> None:
        self.vehicle = vehicle
        self.key = key(vehicle, TRUTH)
        self.late = 0
        self.refused = 0
        self._poses: deque[TruePose] = deque(maxlen=KEPT)
        self._needed_until = -1

    def on_bytes(self, _key: str, data: bytes, _arrived_at: int = 0) -> None:
        try:
            pose = cast("TruePose", decode(TRUTH, data, exact=True))
        except RefusedMessageError:
            self.refused += 1
            return
        if pose.vehicle != self.vehicle:
            self.refused += 1
            return
        self.late += pose.true_at_ns <= self._needed_until
        self._poses.append(pose)

    def newest_at(self, at: int) -> TruePose | None:
        """Newest pose at `at` (ns) or before, None without any; instants must not decrease."""
        self._needed_until = at
        newest: TruePose | None = None
        for pose in self._poses:
            if pose.true_at_ns <= at and (newest is None or pose.true_at_ns > newest.true_at_ns):
                newest = pose
        return newest
