"""The account of a link: the fate of each message that was sent over it.

sent = delivered + dropped + not arrived + in flight + unrecorded. Messages without a verdict are
attributed to holes in the record, to the end of the run, or to times at which a vehicle did not run
or was out of reach. The receiver's last report lists those that had arrived at the end.
"""

from array import array
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scenarios.results.holes import RecordedSeries
from scenarios.results.link_tally import LONGEST_NS, MOST_NUMBERS, RESOLUTION_NS, LinkTally
from vehicles.messages import Health, LinkVerdict, Tracking
from vehicles.schedule import SECOND

# ---- What the log shows of the real transport: sending and receiving of each vehicle


AWAY_NS = SECOND
"""A vehicle whose pose reached the recorder later than this, or not at all, was away."""
FOREVER = 2**63 - 1
"""After every instant (ns)."""
_UNKNOWN = -1

Instants = NDArray[np.int64]


class SentPoses:
    """Poses of one vehicle by number: instants of sending, and their delays to the recorder.

    `delays` counts delays in multiples of RESOLUTION_NS. `is_physical`: a delay differed from 0, as
    in no virtual run.
    """

    def __init__(self) -> None:
        self._sent_at = array("q")
        self._held: set[int] = set()
        self.is_physical = False
        self.delays: Counter[int] = Counter()

    def __len__(self) -> int:
        """Count the messages up to the newest recorded one."""
        return len(self._sent_at)

    def add(self, number: int, sent_at: int, recorded_at: int) -> None:
        """Take a recorded pose; instants are ns."""
        if number >= MOST_NUMBERS:
            return
        missing = number - len(self._sent_at)
        if missing >= 0:
            self._sent_at.extend([_UNKNOWN] * missing)
            self._sent_at.append(sent_at)
        else:
            self._sent_at[number] = sent_at
        if delay := recorded_at - sent_at:
            self.is_physical = True
            if -LONGEST_NS < delay < LONGEST_NS:
                self.delays[delay // RESOLUTION_NS] += 1
            if delay > AWAY_NS:
                self._held.add(number)

    def instants(self, count: int) -> Instants:
        """Instants (ns) of sending of the first `count` messages; interpolated where not recorded.

        Without any recorded pose they are 0.
        """
        given = np.array(self._sent_at, dtype=np.int64)
        (known,) = np.nonzero(given != _UNKNOWN)
        if not len(known):
            return np.zeros(count, dtype=np.int64)
        numbers, first = np.arange(count), int(given[known[0]])
        since = np.interp(numbers, known, given[known] - first)
        beyond = numbers - known[-1]
        if len(known) > 1 and count > known[-1]:
            period = float(np.median(np.diff(given[known]) / np.diff(known)))
            since[beyond > 0] += period * beyond[beyond > 0]
        result: Instants = first + np.round(since).astype(np.int64)
        exact = known[known < count]
        result[exact] = given[exact]
        return result

    @property
    def end_late(self) -> bool:
        """Whether the newest pose was later than AWAY_NS."""
        return len(self._sent_at) - 1 in self._held

    def late_span(self) -> tuple[int, int] | None:
        """Instants (ns) of sending of the first and the last pose that was later than AWAY_NS."""
        if not self._held:
            return None
        return self._sent_at[min(self._held)], self._sent_at[max(self._held)]

    def away(self) -> NDArray[np.bool_]:
        """Whether each message up to the newest was not recorded, or later than AWAY_NS."""
        away: NDArray[np.bool_] = np.array(self._sent_at, dtype=np.int64) == _UNKNOWN
        away[sorted(self._held)] = True
        return away


class ReceiverRecord:
    """Verdicts and decisions of one receiver: where they are missing, and where it did not run."""

    def __init__(self, longest_step_ns: int) -> None:
        """A longer time than `longest_step_ns` between two decisions means that it did not run."""
        self.longest_step_ns = longest_step_ns
        self._next_decision = 0
        self.decided_at: int | None = None
        self.down: list[tuple[int, int]] = []
        """Spans (ns) between two decisions in which its software did not run."""
        self.verdicts = RecordedSeries()

    def begin(self, start_at: int) -> None:
        """Set the start of the run (ns), at which the first decision is due."""
        if self.decided_at is None:
            self.decided_at = start_at

    def add_verdict(self, verdict: LinkVerdict) -> None:
        self.verdicts.add(verdict.seq, verdict.received_at_ns)

    def add_tracking(self, tracking: Tracking) -> None:
        at, before = tracking.decided_at_ns, self.decided_at
        is_next = tracking.seq == self._next_decision
        if is_next and before is not None and at - before > self.longest_step_ns:
            self.down.append((before, at))
        self._next_decision = tracking.seq + 1
        self.decided_at = at

    def holes(self, count: int) -> list[tuple[int, int, int]]:
        """Spans (ns) with missing verdicts, each with their number, of `count` in all."""
        return list(self.verdicts.spans(count, 0, FOREVER))


# ---- Account


Link = tuple[str, str]
"""Sender and receiver."""
Cause = Literal["receiver_down", "late_start", "cut_off", "router_away", "unknown"]
Fate = Cause | Literal["in_flight", "unrecorded"]
CAUSE_WORDS: dict[Fate, str] = {
    "receiver_down": "receiver did not run",
    "late_start": "late start",
    "cut_off": "cut off",
    "router_away": "router away",
    "unknown": "unknown cause",
}
"""Texts of the causes of messages that did not arrive."""
FATE_WORDS: Mapping[Fate, str] = {
    **CAUSE_WORDS,
    "in_flight": "in flight at the end",
    "unrecorded": "its fate is not in the log",
}
TRANSPORT_CAUSES: frozenset[Fate] = frozenset(CAUSE_WORDS) - {"receiver_down"}
"""Causes that lie in the real transport: such messages are lost."""
LATE_START_NS = 5 * SECOND
"""Time from the start in which messages before the first received one are due to a late start."""
MOST_LINKS = 4
"""Links named in one line."""
NEIGHBOURHOOD = 3
"""Number of messages around an instant that show whether a vehicle was away."""
TRANSIT_NS = SECOND // 10
"""Time that a message may take in addition to the link's largest delay."""
LAST_LOOK_NS = SECOND // 10
"""Time from the end of a vehicle to its last look at arrived messages, before its last report."""
CUT_OFF_AFTER_NS = 3 * SECOND
"""A vehicle whose last report is older when its token disappears did not end: it was cut off.

Vehicles report once a second. The token of a process that ends disappears at once, that of one that
is cut off or suspended after the lease of its session.
"""


@dataclass(frozen=True, slots=True)
class MissingVerdict:
    """A message without a recorded verdict; `vehicle` is the one that was cut off."""

    number: int
    sent_at: int
    fate: Fate
    vehicle: str = ""

    @property
    def is_lost(self) -> bool:
        """Whether the real transport lost it."""
        return self.fate in TRANSPORT_CAUSES


@dataclass(frozen=True, slots=True)
class LinkAccount:
    """Messages of one link by their fate.

    `missing` are those without a verdict, in order. `problem` describes counts that contradict each
    other, empty if the account balances.
    """

    sent: int
    delivered: int = 0
    dropped: int = 0
    not_arrived: Mapping[str, int] = field(default_factory=dict)
    in_flight: int = 0
    unrecorded: int = 0
    missing: Sequence[MissingVerdict] = ()
    problem: str = ""

    @property
    def absent(self) -> list[MissingVerdict]:
        """Messages that the real transport lost."""
        return [message for message in self.missing if message.is_lost]

    @property
    def absent_numbers(self) -> list[int]:
        return [message.number for message in self.absent]


class Accounts:
    """Accounts of all links, by the records of their vehicles."""

    def __init__(
        self,
        links: Mapping[Link, LinkTally],
        sent: Mapping[str, SentPoses],
        receivers: Mapping[str, ReceiverRecord],
        counts: Mapping[str, int],
        health: Mapping[str, Health | None],
        *,
        cut_off: Collection[str] = (),
        start_at: int | None,
        end_at: int,
    ) -> None:
        """`counts` are the messages that each vehicle sent by its schedule, 0 without one.

        `health` are the last counters of each vehicle. The `cut_off` vehicles did not return; the
        record ends at `end_at` (ns).
        """
        self._links = links
        self._sent = sent
        self._receivers = receivers
        self._counts = counts
        self._health = health
        self._cut_off = cut_off
        self._start_at = start_at
        self._end_at = end_at
        self._is_physical = any(poses.is_physical for poses in sent.values())
        self._away = {name: _AwayTimes(poses) for name, poses in sent.items() if len(poses)}

    def of_links(self) -> dict[Link, LinkAccount]:
        accounts: dict[Link, LinkAccount] = {}
        for receiver in dict.fromkeys([receiver for _, receiver in self._links]):
            own = [link for link in self._links if link[1] == receiver]
            missing = {link: self._missing(link) for link in own}
            hidden = self._unrecorded(receiver, missing)
            for link in own:
                accounts[link] = self._account(link, missing[link], hidden[link])
        return accounts

    def _count(self, link: Link) -> int:
        """Count the messages sent over a link.

        Those after the sender's last recorded pose are known by its schedule or, without its final
        counters, by verdicts.
        """
        sender, newest = link[0], len(self._links[link].fates)
        count = max(len(self._sent[sender]), self._counts[sender])
        health = self._health[sender]
        return count if health is not None and health.final else max(count, newest)

    def _missing(self, link: Link) -> list[tuple[int, int]]:
        """Numbers and instants of sending of the messages without a verdict."""
        count, fates = self._count(link), self._links[link].fates
        judged = np.zeros(count, dtype=np.bool_)
        judged[: len(fates)] = fates[:count] > 0
        (numbers,) = np.nonzero(~judged)
        if not len(numbers):
            return []
        sent = self._sent[link[0]]
        instants = sent.instants(count)[numbers]
        if not len(sent):
            instants += self._start_at or 0
        return list(zip(numbers.tolist(), instants.tolist(), strict=True))

    def _largest_delay(self, link: Link) -> int:
        return self._links[link].latency_ns_max + TRANSIT_NS

    def _unrecorded(
        self, receiver: str, missing: Mapping[Link, Sequence[tuple[int, int]]]
    ) -> dict[Link, set[int]]:
        """Messages whose verdicts are missing in the log, by the numbers of the verdicts."""
        hidden: dict[Link, set[int]] = {link: set() for link in missing}
        health = self._health[receiver]
        count = health.received + health.dropped if health is not None and health.final else 0
        for begin, end, lacking in self._receivers[receiver].holes(count):
            due = sorted(
                (at, link, number)
                for link, messages in missing.items()
                for number, at in messages
                if number not in hidden[link] and begin - self._largest_delay(link) <= at < end
            )
            for _, link, number in due[:lacking]:
                hidden[link].add(number)
        return hidden

    def _account(
        self, link: Link, missing: Sequence[tuple[int, int]], hidden: set[int]
    ) -> LinkAccount:
        tally, causes = self._links[link], Counter[Fate]()
        (judged,) = np.nonzero(tally.fates)
        first = int(judged[0]) if len(judged) else 0
        waiting = _Waiting(self._health[link[1]], link[0])
        without = list[MissingVerdict]()
        for number, at in missing:
            fate, vehicle = self._fate(link, at, is_before_first=number < first)
            if number in waiting:
                fate, vehicle = "in_flight", ""
            elif number in hidden:
                fate, vehicle = "unrecorded", ""
            without.append(MissingVerdict(number, at, fate, vehicle))
            causes[fate] += 1
        account = LinkAccount(
            sent=self._count(link),
            delivered=tally.delivered,
            dropped=tally.dropped.total(),
            not_arrived={cause: causes[cause] for cause in CAUSE_WORDS if causes[cause]},
            in_flight=causes["in_flight"],
            unrecorded=causes["unrecorded"],
            missing=without,
        )
        return replace(account, problem=_problem(link, account, int((judged < account.sent).sum())))

    def _fate(self, link: Link, at: int, *, is_before_first: bool) -> tuple[Fate, str]:
        """Fate of a message without a verdict, and the vehicle that was cut off, if any."""
        reception, due_at = self._receivers[link[1]], at + self._largest_delay(link)
        if link[1] in self._cut_off and due_at >= (reception.decided_at or 0):
            return "cut_off", link[1]
        if self._is_down(reception, at, due_at):
            return "receiver_down", ""
        if not self._is_physical or self._may_be_under_way(link, at, due_at):
            return "in_flight", ""
        decided_at = reception.decided_at
        if decided_at is not None and due_at >= decided_at and not self._lists_arrivals(link):
            return "unrecorded", ""
        begun_at = self._end_at if self._start_at is None else self._start_at
        if is_before_first and at < begun_at + LATE_START_NS:
            return "late_start", ""
        return self._transport_cause(link, at)

    def _may_be_under_way(self, link: Link, at: int, due_at: int) -> bool:
        """Whether a message may have arrived after the receiver's last look.

        Without a last report of an arrival this is known up to TRANSIT_NS.
        """
        health = self._health[link[1]]
        if health is None or not self._lists_arrivals(link):
            return due_at >= self._end_at - TRANSIT_NS
        longest = max(self._links[link].transport) * RESOLUTION_NS
        return at + longest >= health.reported_at_ns + LAST_LOOK_NS

    def _lists_arrivals(self, link: Link) -> bool:
        """Whether the receiver's last report lists the messages that had arrived."""
        health = self._health[link[1]]
        return health is not None and health.final and bool(self._links[link].transport)

    def _transport_cause(self, link: Link, at: int) -> tuple[Cause, str]:
        """Cause of a loss by the vehicles that were away at an instant (ns) of sending."""
        away = [
            name
            for name, times in self._away.items()
            if times.is_away(at) or (name in self._cut_off and at > times.last_at)
        ]
        away += [name for name in self._cut_off if name not in self._away]
        if len(away) == len(self._away) > 1:
            return "router_away", ""
        for name in reversed(link):
            if name in away:
                return "cut_off", name
        return "unknown", ""

    def _is_down(self, reception: ReceiverRecord, at: int, due_at: int) -> bool:
        """Whether the receiver's software did not run when a message should have arrived."""
        latest = due_at if self._is_physical else FOREVER
        if any(begin <= latest and at < end for begin, end in reception.down):
            return True
        if reception.decided_at is None:
            return not reception.verdicts.received
        allowed = SECOND if self._is_physical else reception.longest_step_ns
        return self._end_at - reception.decided_at > allowed and reception.decided_at <= latest


def _problem(link: Link, account: LinkAccount, judged: int) -> str:
    """Describe counts that contradict each other; empty if the account balances."""
    verdicts = account.delivered + account.dropped
    total = verdicts + sum(account.not_arrived.values()) + account.in_flight + account.unrecorded
    if total == account.sent and judged == verdicts:
        return ""
    return (
        f"{link[0]} → {link[1]}: the account does not balance: {account.sent} messages sent, "
        f"{total} accounted for ({verdicts} verdicts on {judged} of them)"
    )


class _Waiting:
    """Messages of one sender that had arrived at the end, by the receiver's last report."""

    def __init__(self, health: Health | None, sender: str) -> None:
        text = "" if health is None else health.waiting
        rows = [row.rsplit(" ", 2) for row in text.split(",")]
        self._ranges: list[tuple[int, int]] = []
        for name, *numbers in rows:
            with suppress(ValueError):  # messages from the bus may be malformed
                first, last = map(int, numbers)
                if name == sender:
                    self._ranges.append((first, last))

    def __contains__(self, number: int) -> bool:
        return any(first <= number <= last for first, last in self._ranges)


class _AwayTimes:
    """When a vehicle was out of reach of the recorder, by its poses."""

    def __init__(self, poses: SentPoses) -> None:
        self._away = poses.away()
        self._sent_at = poses.instants(len(poses))
        self.last_at = int(self._sent_at[-1])

    def is_away(self, at: int) -> bool:
        """Whether one of the poses around an instant (ns) was missing or late at the recorder."""
        place = int(np.searchsorted(self._sent_at, at))
        return bool(self._away[max(place - NEIGHBOURHOOD, 0) : place + NEIGHBOURHOOD].any())


def absence_lines(
    accounts: Mapping[Link, LinkAccount], seconds: Callable[[int], float]
) -> Iterator[str]:
    """Yield a line per cause and vehicle for messages that the real transport lost."""
    lost: dict[tuple[Fate, str], list[tuple[Link, int]]] = {}
    for link, account in accounts.items():
        for message in account.absent:
            lost.setdefault((message.fate, message.vehicle), []).append((link, message.sent_at))
    for (fate, vehicle), messages in lost.items():
        links = [f"{a} → {b}" for a, b in dict.fromkeys(link for link, _ in messages)]
        over = ", ".join(links[:MOST_LINKS]) + (", …" if len(links) > MOST_LINKS else "")
        begin, end = (seconds(pick(at for _, at in messages)) for pick in (min, max))
        words = f"{vehicle} {FATE_WORDS[fate]}" if vehicle else FATE_WORDS[fate]
        count = "1 message" if len(messages) == 1 else f"{len(messages)} messages"
        yield f"{count} did not arrive over {over}, sent {begin:.2f} to {end:.2f} s: {words}"
