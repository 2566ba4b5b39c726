"""Each vehicle confirms the end of a completed run.

The token of a vehicle also disappears when the vehicle is cut off. Only its confirmation proves
that it has received the end.
"""

from collections.abc import Collection
from secrets import token_hex
from threading import Event

from transport.bus.bus import Bus
from transport.clock import SYSTEM_TIME, SystemTime
from transport.topics import RUN_SENDER, end_key

# ---- Queries that name their run: members of another run with the same name do not answer them


def random_run_id() -> str:
    return token_hex(8)


def addressed(run_id: str, content: bytes) -> bytes:
    """Query to members of the run with this identifier."""
    return run_id.encode() + b"\n" + content


def content_of(query: bytes, run_id: str) -> bytes | None:
    """Content of a query to this run; None for any other query, or while the run is unknown."""
    addressee, line_feed, content = query.partition(b"\n")
    return content if line_feed and run_id and addressee == run_id.encode() else None


# ---- End confirmation


RETRY_S = 0.25
"""Time between two confirmations; late answers count too."""
ATTEMPTS = 8
TIMEOUT_S = ATTEMPTS * RETRY_S
RECEIVED = b"received"


class EndConfirmations:
    """Vehicles of a run that have confirmed its end; any of `vehicles` may confirm."""

    def __init__(self, bus: Bus, vehicles: Collection[str], run_id: str) -> None:
        self.received: set[str] = set()
        self._vehicles = frozenset(vehicles)
        self._run_id = run_id
        bus.answer(end_key(RUN_SENDER), self._answer)

    def _answer(self, payload: bytes) -> bytes:
        vehicle = (content_of(payload, self._run_id) or b"").decode(errors="replace")
        if vehicle not in self._vehicles:
            return b""
        self.received.add(vehicle)
        return RECEIVED


def confirm_end(bus: Bus, vehicle: str, run_id: str, system: SystemTime = SYSTEM_TIME) -> None:
    """Confirm the end until the recorder answers, at most TIMEOUT_S."""
    answered = Event()

    def receive(answer: bytes) -> None:
        if answer == RECEIVED:
            answered.set()

    for _ in range(ATTEMPTS):
        bus.request(end_key(RUN_SENDER), receive, TIMEOUT_S, addressed(run_id, vehicle.encode()))
        system.wait(answered, RETRY_S)
        if answered.is_set():
            return
