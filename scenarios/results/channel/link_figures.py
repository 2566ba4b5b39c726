"""Gathers the figures of all links of a run."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

from scenarios.definition.changing.live_change import changed_links
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.channel.link_summary import (
    AlarmSummary,
    LinkSummary,
    link_summary,
    request_deviations,
)
from scenarios.results.channel.link_tally import AlarmTally, LinkTally
from vehicles.messages import Change, LinkVerdict, Tracking

Link = tuple[str, str]
"""Sender and receiver."""
_Source = tuple[LinkTally, AlarmTally]
"""Counts of the link from one source of a follower."""


class LinkFigures:
    """Gathers verdicts, data ages and false alarms of each directed link."""

    def __init__(self, names: Sequence[str], requested: Mapping[Link, LinkTable]) -> None:
        self._names = list(names)
        self._requested = requested
        self._ahead = {behind: ahead for ahead, behind in pairwise(self._names)}
        self.tallies: defaultdict[Link, LinkTally] = defaultdict(LinkTally)
        self._alarms: defaultdict[Link, AlarmTally] = defaultdict(AlarmTally)
        self._sources: dict[str, tuple[_Source | None, _Source | None]] = {}

    def add_verdict(self, verdict: LinkVerdict) -> None:
        link = verdict.sender, verdict.vehicle
        if link in self._requested:
            self.tallies[link].add(verdict)

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

    def summaries(self, sent: Mapping[str, tuple[int, int]]) -> tuple[LinkSummary, ...]:
        """Figures per link, by receiver and then sender from the lead on.

        `sent` holds each vehicle's recorded poses and the instant (ns) of its last message, up to
        which alarms are false.
        """
        summaries = []
        for link in self._in_order():
            poses, last_at = sent[link[0]]
            alarms = AlarmSummary(counted=self._alarms[link].counted(last_at))
            summaries.append(
                link_summary(link, self._requested[link], poses, self.tallies[link], alarms)
            )
        return tuple(summaries)

    def _in_order(self) -> list[Link]:
        place = self._names.index
        return sorted(self._requested, key=lambda link: (place(link[1]), place(link[0])))

    def request_deviations(self) -> Iterator[str]:
        """Yield deviations from the requests beyond sampling error."""
        for link in self._in_order():
            yield from request_deviations(link, self._requested[link], self.tallies[link])
        changed = [f"{a} → {b}" for (a, b), tally in sorted(self.tallies.items()) if tally.changed]
        if changed:
            these = "all" if len(changed) == len(self._requested) else ", ".join(changed)
            yield f"no requested values are shown for links changed during the run: {these}"
