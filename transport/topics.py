"""Table of the topics of a convoy; publisher, recorder, log and reference read it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

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
from vehicles.schedule import SECOND


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


# ---- Reasons
#
# Table of the reasons for unused poses; links, recorder, figures, picture and reference read it.
#
# A link drops messages; its verdicts are logged. A receiver refuses messages that cannot be poses
# of the run or overflow its queue; they are counted.


DropReason = Literal[
    "rate",
    "transmitter_off",
    "receiver_off",
    "outage",
    "cut",
    "loss",
    "burst",
    "pattern",
    "collision",
    "range",
    "queue",
    "corrupted",
]

RefusalReason = Literal[
    "garbage",
    "oversized",
    "unknown",
    "foreign",
    "reserved",
    "absurd",
    "far",
    "early",
    "past",
    "future",
    "sequence",
    "duplicate",
    "overflow",
]


@dataclass(frozen=True, slots=True)
class Reason:
    """One reason, and whether such messages count as lost or as late."""

    word: DropReason | RefusalReason
    counts_as_loss: bool
    counts_as_late: bool
    meaning: str

    @property
    def is_drop(self) -> bool:
        return self.word in get_args(DropReason)


# fmt: off
_REASON_ROWS = (
    #      word               loss   late   meaning
    Reason("rate",            False, False, "the link carries fewer messages than are sent"),
    Reason("transmitter_off", True,  False, "the sender's transmitter was off"),
    Reason("receiver_off",    True,  False, "the receiver's radio was off"),
    Reason("outage",          True,  False, "sent during an outage of the link"),
    Reason("cut",             True,  False, "sent while the link was cut by a change to the run"),
    Reason("loss",            True,  False, "random loss: independent of other messages"),
    Reason("burst",           True,  False, "lost in a burst (Markov chain)"),
    Reason("pattern",         True,  False, "lost by its number: listed, every n-th or recorded"),
    Reason("collision",       True,  False, "radio resource was also used by another sender"),
    Reason("range",           True,  False, "signal too weak over the distance or behind vehicles"),
    Reason("queue",           True,  False, "the sender's queue was full"),
    Reason("corrupted",       True,  False, "altered by the link, rejected by checksum or content"),
    Reason("garbage",         False, False, "bytes are not a complete message of the topic"),
    Reason("oversized",       False, False, "larger than any message of the topic"),
    Reason("unknown",         False, False, "unknown topic, or no link from the sender"),
    Reason("foreign",         False, False, "names another vehicle than its key, or another run"),
    Reason("reserved",        False, False, "sent under the recorder's name"),
    Reason("absurd",          False, False, "a value is out of range or not finite"),
    Reason("far",             False, False, "more than 100 km from the scenario's origin"),
    Reason("early",           False, False, "measured before the start of the run"),
    Reason("past",            False, True,  "measured more than 60 s ago"),
    Reason("future",          False, False, "measured more than 60 s ahead"),
    Reason("sequence",        False, False, "numbered ahead of the sender's schedule"),
    Reason("duplicate",       False, False, "number was received before"),
    Reason("overflow",        False, False, "the receiver's queue was full"),
)
# fmt: on
REASONS: Mapping[str, Reason] = {row.word: row for row in _REASON_ROWS}


def counts_as_loss(word: str) -> bool:
    """Whether messages dropped for this reason count as lost; unknown reasons of later logs do."""
    reason = REASONS.get(word)
    return reason is None or reason.counts_as_loss


def counts_as_late(word: str) -> bool:
    """Whether messages refused for this reason count as late."""
    reason = REASONS.get(word)
    return reason is not None and reason.counts_as_late


# ---- Thinning of topics in a log


class Thinning:
    """Keeps the first message per period of each vehicle and topic.

    `rates_hz` are the maximum rates by topic: 0 keeps no message, a missing rate keeps all.
    """

    def __init__(self, rates_hz: Mapping[str, float]) -> None:
        self.rates_hz = dict(rates_hz)
        self._periods = {
            topic: round(SECOND / rate_hz) if rate_hz else 0 for topic, rate_hz in rates_hz.items()
        }
        self._last: dict[tuple[str, str], int] = {}

    def drops_all(self, topic: str) -> bool:
        return self._periods.get(topic) == 0

    def keeps(self, topic: str, vehicle: str, valid_at: int) -> bool:
        """Whether to keep a message that was valid at an instant (ns); call in order of time."""
        period = self._periods.get(topic)
        if period is None:
            return True
        if not period:
            return False
        number = valid_at // period
        if self._last.get((vehicle, topic)) == number:
            return False
        self._last[vehicle, topic] = number
        return True
