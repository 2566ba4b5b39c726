"""Table of the topics of a convoy; publisher, recorder, log and reference read it."""

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
    """The message published under `convoy/<vehicle>/<name>`; the recorder logs all of them.

    `instant` is the field with the instant at which the message was valid. `urgent` messages
    precede other traffic on the same Zenoh link; `batched` messages, which only the log and the
    picture need, are sent together.
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
    Topic("gps",        GpsPose,             "sent_at_ns",      True,  False,   "GNSS measurement as broadcast"),
    Topic("truth",      TruePose,            "true_at_ns",      False, True,    "true state of the simulated car"),
    Topic("trajectory", CompositeTrajectory, "decided_at_ns",   False, True,    "composite trajectory and the samples it was fitted to"),
    Topic("tracking",   Tracking,            "decided_at_ns",   False, True,    "errors and sources as the vehicle estimates them"),
    Topic("command",    Command,             "decided_at_ns",   False, True,    "commanded steering angle and acceleration"),
    Topic("verdict",    LinkVerdict,         "received_at_ns",  False, True,    "verdict of a link on each message, with the reason"),
    Topic("health",     Health,              "reported_at_ns",  False, False,   "counters of the process, once a second"),
    Topic("log",        LogText,             "logged_at_ns",    False, False,   "line of text"),
    Topic("change",     Change,              "effective_at_ns", False, False,   "change to the running convoy, by the scenario or by hand"),
    Topic("start",      RunStart,            "start_at_ns",     True,  False,   "common start instant of all vehicles"),
    Topic("end",        RunEnd,              "end_at_ns",       True,  False,   "end of the run, with the reason"),
)
# fmt: on
TOPICS: Mapping[str, Topic] = {row.name: row for row in _ROWS}
TOPIC_OF: Mapping[type[Message], Topic] = {row.message: row for row in _ROWS}
RUN_SENDER = "run"  # Sender of messages about the run; reserved as a vehicle name


def key(vehicle: str, topic: Topic) -> str:
    """Zenoh key of a vehicle's topic; the log prepends a slash."""
    return f"convoy/{vehicle}/{topic.name}"


def clock_key(vehicle: str) -> str:
    return f"convoy/@clock/{vehicle}"


def end_key(vehicle: str) -> str:
    """Key of queries by which vehicles confirm the end of a run."""
    return f"convoy/@end/{vehicle}"


def control_key(vehicle: str) -> str:
    """Key of queries that change a running vehicle or read the status of the run."""
    return f"convoy/@control/{vehicle}"


def alive_key(role: str, name: str, fingerprint: str, session: str) -> str:
    """Liveliness token of a member of the run; no subscription to messages matches it."""
    return f"convoy/@alive/{role}/{name}/{fingerprint}/{session}"


def valid_at(message: Message) -> int:
    """Instant (ns) at which a message was valid."""
    at: int = getattr(message, TOPIC_OF[type(message)].instant)
    return at
