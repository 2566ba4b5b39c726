"""The topics of a convoy as a table: publisher, recorder, viewer and tests all read it."""

from collections.abc import Mapping
from dataclasses import dataclass

from vehicles.messages import (
    Command,
    CompositeTrajectory,
    GpsPose,
    Health,
    LinkVerdict,
    LogText,
    Message,
    RunEnd,
    RunStart,
    Tracking,
    TruePose,
)


@dataclass(frozen=True, slots=True)
class Topic:
    """One row: what is published under `convoy/<vehicle>/<name>`."""

    name: str
    message: type[Message]
    instant: str  # the message's field that says when it was valid
    rate: str  # what sets its rate
    logged: bool
    queue: int  # messages a receiver holds at most, the oldest go first
    urgent: bool  # ahead of other traffic on the same link
    on_change: bool = False


# fmt: off
_ROWS = (
    #     name          message              instant           rate       logged queue  urgent
    Topic("gps",        GpsPose,             "measured_at_ns", "gnss",    True,  4096,  True),
    Topic("truth",      TruePose,            "true_at_ns",     "control", True,  65536, False),
    Topic("trajectory", CompositeTrajectory, "decided_at_ns",  "control", True,  65536, False),
    Topic("tracking",   Tracking,            "decided_at_ns",  "control", True,  65536, False),
    Topic("command",    Command,             "decided_at_ns",  "control", True,  65536, False),
    Topic("verdict",    LinkVerdict,         "heard_at_ns",    "gnss",    True,  65536, False),
    Topic("health",     Health,              "reported_at_ns", "1 Hz",    True,  4096,  False),
    Topic("log",        LogText,             "logged_at_ns",   "event",   True,  4096,  False),
    Topic("start",      RunStart,            "start_at_ns",    "event",   True,  16,    True),
    Topic("end",        RunEnd,              "end_at_ns",      "event",   True,  16,    True),
)
# fmt: on
TOPICS: Mapping[str, Topic] = {row.name: row for row in _ROWS}
TOPIC_OF: Mapping[type[Message], Topic] = {row.message: row for row in _ROWS}
CONDUCTOR = "run"
"""Publishes the start instant under `convoy/run/start`; no vehicle may have this name."""


def key(vehicle: str, topic: Topic) -> str:
    """Zenoh key expression of a vehicle's topic; in the log the same with a leading slash."""
    return f"convoy/{vehicle}/{topic.name}"


def alive_key(vehicle: str) -> str:
    """Liveliness token of a vehicle."""
    return f"convoy/{vehicle}/@alive"


def instant(message: Message) -> int:
    """Return the instant at which `message` was valid, in nanoseconds."""
    at: int = getattr(message, TOPIC_OF[type(message)].instant)
    return at
