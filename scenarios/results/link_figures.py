"""Gathers the figures of all links of a run."""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import pairwise

from scenarios.definition.changes import changed_links
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.account import (
    AWAY_NS,
    Accounts,
    Link,
    LinkAccount,
    ReceiverRecord,
    SentPoses,
)
from scenarios.results.link_summary import (
    AlarmSummary,
    LinkSummary,
    link_summary,
    request_deviations,
)
from scenarios.results.link_tally import AlarmTally, LinkTally
from vehicles.messages import Change, Health, LinkVerdict, Tracking
from vehicles.schedule import SECOND

LONGEST_STEP = 1.5
"""Time, in control periods, between two decisions of software that runs."""
_Source = tuple[LinkTally, AlarmTally]
"""Counts of the link from one source of a follower."""


class LinkFigures:
    """Gathers verdicts, data ages and false alarms of each directed link."""

    def __init__(
        self, names: Sequence[str], requested: Mapping[Link, LinkTable], control_rate_hz: float
    ) -> None:
        self._names = list(names)
        self._requested = requested
        self._ahead = {behind: ahead for ahead, behind in pairwise(self._names)}
        self.tallies: defaultdict[Link, LinkTally] = defaultdict(LinkTally)
        self.sent = {name: SentPoses() for name in names}
        longest_step_ns = round(LONGEST_STEP * SECOND / control_rate_hz)
        self._receivers = {name: ReceiverRecord(longest_step_ns) for name in names}
        self._alarms: defaultdict[Link, AlarmTally] = defaultdict(AlarmTally)
        self._sources: dict[str, tuple[_Source | None, _Source | None]] = {}

    def add_verdict(self, verdict: LinkVerdict) -> None:
        link = verdict.sender, verdict.vehicle
        if link in self._requested:
            self.tallies[link].add(verdict)
        self._receivers[verdict.vehicle].add_verdict(verdict)

    def begin(self, start_at: int) -> None:
        """Set the start of the run (ns)."""
        for reception in self._receivers.values():
            reception.begin(start_at)

    def add_decision(self, tracking: Tracking) -> None:
        """Take a decision of any vehicle, which shows that its software runs."""
        self._receivers[tracking.vehicle].add_tracking(tracking)

    def add_tracking(self, tracking: Tracking, at: int) -> None:
        """Take the ages of a follower's data at instant `at` (ns)."""
        sources = self._sources.get(tracking.vehicle)
        if sources is None:
            sources = self._sources[tracking.vehicle] = self._sources_of(tracking.vehicle)
        lead, ahead = sources
        if lead is not None:
            tally, alarms = lead
            tally.add_age(tracking.lead_age_s)
            alarms.add(at, tracking.lead_status)
        if ahead is not None:
            tally, alarms = ahead
            tally.add_age(tracking.predecessor_age_s)
            alarms.add(at, tracking.predecessor_status)
        if tracking.other_sources:
            self._add_others(tracking, at)

    def _add_others(self, tracking: Tracking, at: int) -> None:
        """Take the ages of the sources that are neither lead nor predecessor.

        A message that was read by columns lacks its lists, and so the ages.
        """
        for (name, status), age in zip(
            tracking.statuses().items(), tracking.other_age_s, strict=False
        ):
            link = name, tracking.vehicle
            if link in self._requested:
                self.tallies[link].add_age(age)
                self._alarms[link].add(at, status)

    def _sources_of(self, name: str) -> tuple[_Source | None, _Source | None]:
        """Sources of a follower; the first follower has only the lead."""
        lead, ahead = self._names[0], self._ahead[name]
        return self._source(lead, name), self._source(ahead, name) if ahead != lead else None

    def _source(self, sender: str, receiver: str) -> _Source | None:
        link = sender, receiver
        return (self.tallies[link], self._alarms[link]) if link in self._requested else None

    def add_change(self, change: Change) -> None:
        for link in changed_links(change.table, self._names, self._requested):
            self.tallies[link].changed |= link[1] == change.vehicle

    def accounts(
        self,
        counts: Mapping[str, int],
        health: Mapping[str, Health | None],
        *,
        cut_off: Collection[str],
        start_at: int | None,
        end_at: int,
    ) -> dict[Link, LinkAccount]:
        """Accounts of the messages of each link, see `Accounts`."""
        accounts = Accounts(
            {link: self.tallies[link] for link in self._in_order()},
            self.sent,
            self._receivers,
            counts,
            health,
            cut_off=cut_off,
            start_at=start_at,
            end_at=end_at,
        )
        return accounts.of_links()

    def summaries(
        self, accounts: Mapping[Link, LinkAccount], last_at: Mapping[str, int]
    ) -> tuple[LinkSummary, ...]:
        """Figures per link, by receiver and then sender from the lead on.

        `last_at` is the instant (ns) of each vehicle's last message, up to which alarms are false.
        """
        summaries = []
        for link in self._in_order():
            alarms = AlarmSummary(counted=self._alarms[link].counted(last_at[link[0]]))
            requested, tally = self._requested[link], self.tallies[link]
            transport = tally.transport or self.sent[link[0]].delays
            summaries.append(
                link_summary(
                    link, requested, accounts[link], tally, alarms=alarms, transport=transport
                )
            )
        return tuple(summaries)

    def away_lines(self, seconds: Callable[[int], float]) -> Iterator[str]:
        """Yield a line per vehicle whose poses reached the recorder very late."""
        late = {name: span for name, poses in self.sent.items() if (span := poses.late_span())}
        if len(late) == len(self.sent) > 1:
            spans = late.values()
            late = {"every vehicle": (min(b for b, _ in spans), max(e for _, e in spans))}
        for name, (begin, end) in late.items():
            yield (
                f"{name} was out of reach for a while: poses of {seconds(begin):.2f} to "
                f"{seconds(end):.2f} s reached the recorder more than {AWAY_NS / SECOND:g} s late"
            )

    def _in_order(self) -> list[Link]:
        place = self._names.index
        return sorted(self._requested, key=lambda link: (place(link[1]), place(link[0])))

    def request_deviations(self, accounts: Mapping[Link, LinkAccount]) -> Iterator[str]:
        """Yield deviations from the requests beyond sampling error."""
        for link in self._in_order():
            absent = accounts[link].absent_numbers
            yield from request_deviations(link, self._requested[link], self.tallies[link], absent)
        changed = [f"{a} → {b}" for (a, b), tally in sorted(self.tallies.items()) if tally.changed]
        if changed:
            these = "all" if len(changed) == len(self._requested) else ", ".join(changed)
            yield f"no requested values are shown for links changed during the run: {these}"
