"""A network cable that delays and loses Ethernet frames, as a process.

`python -m tests.system.hosts.cable NEAR FAR DELAY_MS LOSS_RATIO` creates the devices NEAR and FAR,
prints READY, and carries frames between them until its input ends. The devices may be moved into
network namespaces meanwhile. Lines of input: CUT and MEND.
"""

import fcntl
import os
import random
import select
import struct
import sys
import time
from collections import deque

READY, CUT, MEND = "ready", "cut", "mend"
LONGEST_FRAME = 65_536
_CREATE_DEVICE = 0x400454CA
"""TUNSETIFF, see linux/if_tun.h."""
_ETHERNET_FRAMES = 0x0002 | 0x1000
"""IFF_TAP | IFF_NO_PI: whole frames without a header."""


def opened_device(name: str) -> int:
    descriptor = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(descriptor, _CREATE_DEVICE, struct.pack("16sH14x", name.encode(), _ETHERNET_FRAMES))
    return descriptor


class Cable:
    """Frames under way between two devices, in both directions with the same delay (s)."""

    def __init__(self, ends: tuple[int, int], delay_s: float, loss_ratio: float) -> None:
        self._other = dict(zip(ends, reversed(ends), strict=True))
        self._delay_s = delay_s
        self._loss_ratio = loss_ratio
        self._draw = random.Random(1)
        self._under_way: deque[tuple[float, int, bytes]] = deque()
        self.is_cut = False

    def take(self, end: int) -> None:
        """Take all frames that wait at an end."""
        due_at = time.monotonic() + self._delay_s
        while True:
            try:
                frame = os.read(end, LONGEST_FRAME)
            except OSError:  # no further frame, or the device is down
                return
            if not self.is_cut and self._draw.random() >= self._loss_ratio:
                self._under_way.append((due_at, self._other[end], frame))

    def deliver(self) -> float:
        """Deliver the frames that are due; returns the time (s) until the next one."""
        while self._under_way:
            due_at, end, frame = self._under_way[0]
            remaining = due_at - time.monotonic()
            if remaining > 0.0:
                return remaining
            self._under_way.popleft()
            try:
                os.write(end, frame)
            except OSError:  # the device is down
                continue
        return 1.0

    def carry(self) -> None:
        """Carry frames until the standard input ends."""
        commands, wait_s = sys.stdin.fileno(), 1.0
        while True:
            for ready in select.select([*self._other, commands], [], [], wait_s)[0]:
                if ready != commands:
                    self.take(ready)
                    continue
                line = os.read(commands, 100).decode()
                if not line:
                    return
                self.is_cut = line.strip() == CUT
            wait_s = self.deliver()


def main(near: str, far: str, delay_ms: str, loss_ratio: str) -> None:
    cable = Cable(
        (opened_device(near), opened_device(far)), float(delay_ms) / 1000.0, float(loss_ratio)
    )
    print(READY, flush=True)
    cable.carry()


if __name__ == "__main__":
    main(*sys.argv[1:])
