"""The topics of a convoy as a table: publisher, recorder, log and reference follow it."""

from collections.abc import Mapping
from dataclasses import dataclass

from vehicles.messages import (
    Change,
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
    """One row: what is published under `convoy/<vehicle>/<name>`.

    The recorder writes them all. `instant` is the field with the instant at which the message was
    valid. An `urgent` message precedes other traffic on the same link; `batched` messages, which
    only log and picture need, are sent together.
    """

    name: str
    message: type[Message]
    instant: str
    urgent: bool
    batched: bool
    meaning: str


# fmt: off
_ROWS = (
    #     name          message              instant            urgent batched meaning
    Topic("gps",        GpsPose,             "sent_at_ns",      True,  False,   "what the receiver measured, as broadcast"),
    Topic("truth",      TruePose,            "true_at_ns",      False, True,    "where the car really is"),
    Topic("trajectory", CompositeTrajectory, "decided_at_ns",   False, True,    "arc spline and the samples it was fitted to"),
    Topic("tracking",   Tracking,            "decided_at_ns",   False, True,    "errors as the vehicle sees them"),
    Topic("command",    Command,             "decided_at_ns",   False, True,    "steering and acceleration asked for"),
    Topic("verdict",    LinkVerdict,         "received_at_ns",  False, True,    "what the link did to each message, and why"),
    Topic("health",     Health,              "reported_at_ns",  False, False,   "counters of the process, once a second"),
    Topic("log",        LogText,             "logged_at_ns",    False, False,   "text"),
    Topic("change",     Change,              "effective_at_ns", False, False,   "something done to the running convoy, by its scenario or by hand"),
    Topic("start",      RunStart,            "start_at_ns",     True,  False,   "the instant at which all start"),
    Topic("end",        RunEnd,              "end_at_ns",       True,  False,   "the run is over, and why"),
)
# fmt: on
TOPICS: Mapping[str, Topic] = {row.name: row for row in _ROWS}
TOPIC_OF: Mapping[type[Message], Topic] = {row.message: row for row in _ROWS}
RUN_SENDER = "run"
"""Publishes the start instant under `convoy/run/start`; no vehicle may have this name."""


def key(vehicle: str, topic: Topic) -> str:
    """Zenoh key expression of a vehicle's topic; in the log the same with a leading slash."""
    return f"convoy/{vehicle}/{topic.name}"


def clock_key(vehicle: str) -> str:
    """Key of queries for the clock of a vehicle."""
    return f"convoy/@clock/{vehicle}"


def control_key(vehicle: str) -> str:
    """Key of requests to change a running vehicle, or for the status of the run."""
    return f"convoy/@control/{vehicle}"


def alive_key(role: str, name: str, fingerprint: str, session: str) -> str:
    """Liveliness token of a member of the run; subscriptions to messages do not match it."""
    return f"convoy/@alive/{role}/{name}/{fingerprint}/{session}"


def valid_at(message: Message) -> int:
    """Instant (ns) at which `message` was valid."""
    at: int = getattr(message, TOPIC_OF[type(message)].instant)
    return at
