"""A recorded run as a scenario that loses exactly the messages of a list, and no others.

Delays, order and content stay, as draws are keyed by the message. Where the fate of a message also
depended on others, in a queue, or on changes of its link, its recorded delay replaces the link's
laws.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from scenarios.definition.changing.link_changes import LINK_CHANGES, links_of
from scenarios.definition.channel.recordings import run_lengths
from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.link_tables import LinkEntry, LinkTable
from scenarios.studies.many.blame.losses import (
    LinkEnds,
    LostMessage,
    RecordedRun,
    numbers_by_link,
)
from transport.links.laws.loss.by_number import Listed
from transport.links.laws.loss.earlier_run import EarlierRun
from transport.links.laws.loss.number_sets import NumberSet
from vehicles.schedule import SECOND

LOSES = {"loss", "loss_ratio", "collisions", "outages", "radio", "preset", "preset_source"}
"""Keys of a link by which it loses messages; others delay or alter them."""
RECORDED_DELAY = {"queue"}
"""Keys that are left out where delays were recorded. Those take the place of the others, too, by
which vehicles know meanwhile what to expect of the link."""


@dataclass(frozen=True)
class LossFreeScenario:
    """A scenario without any loss, to which listed losses can be added."""

    scenario: Scenario

    def with_losses(self, lost: Iterable[LostMessage]) -> Scenario:
        numbers = numbers_by_link(lost)
        entries = tuple(
            _note_loss(entry, numbers.get((entry.sender, entry.receiver)))
            for entry in self.scenario.tables.link
        )
        return Scenario(self.scenario.tables.model_copy(update={"link": entries}))

    def smallest(self, lost: Iterable[LostMessage], limit: Limit, description: str) -> Scenario:
        """Return the scenario with these losses, whose only limit is `limit`."""
        tables = self.with_losses(lost).tables
        changes = {
            "name": f"{tables.name[:20]}_blamed",
            "description": description,
            "limits": limit.table,
        }
        return Scenario(tables.model_copy(update=changes))


def _note_loss(entry: LinkEntry, numbers: NumberSet | None) -> LinkEntry:
    if numbers is None:
        return entry
    if isinstance(entry.loss, EarlierRun):
        dropped = {**entry.loss.dropped_numbers, "pattern": str(numbers)}
        return entry.model_copy(
            update={"loss": entry.loss.model_copy(update={"dropped_numbers": dropped})}
        )
    return entry.model_copy(update={"loss": Listed(kind="listed", lost_numbers=str(numbers))})


def loss_free(run: RecordedRun) -> LossFreeScenario:
    """Return the scenario of a recorded run without its losses."""
    scenario = run.scenario
    changes = [one for one in scenario.tables.change if isinstance(one, LINK_CHANGES)]
    changed = {
        pair for one in changes for pair in links_of(one, scenario.vehicle_names, scenario.links)
    }
    entries = []
    for pair, table in scenario.links.items():
        recorded = pair in changed or table.queue is not None or isinstance(table.loss, EarlierRun)
        if recorded:
            entries.append(_recorded(run, pair, table))
        else:  # delays are drawn again, each by its message's number
            listed = Listed(kind="listed", lost_numbers="")
            entries.append(_entry(pair, table, also_left_out=set(), loss=listed))
    tables = scenario.tables.model_copy(
        update={
            "overrides": None,
            "links": LinkTable(),
            "link": tuple(entries),
            "change": tuple(
                one for one in scenario.tables.change if not isinstance(one, LINK_CHANGES)
            ),
            "vehicle": {
                name: one.model_copy(update={"transmitter_off": (), "receiver_off": ()})
                for name, one in scenario.tables.vehicle.items()
            },
        }
    )
    return LossFreeScenario(Scenario(tables))


def _recorded(run: RecordedRun, pair: LinkEnds, table: LinkTable) -> LinkEntry:
    """Build the entry of a link whose delays were recorded.

    Messages not yet visible when the run ended become visible a second later.
    """
    fates, ends_at = run.fates[pair], round(run.scenario.duration_s * SECOND)
    sent = run.sent[pair[0]]
    delays = [
        fates[number].delay
        if number in fates
        else max(ends_at + SECOND - sent.get(number, ends_at), 0)
        for number in range(max([*fates, *sent, 0]) + 1)
    ]
    by_rate = NumberSet.of((k, k) for k, fate in fates.items() if fate.reason and not fate.is_lost)
    loss = EarlierRun(
        kind="log",
        source=run.log.name,
        after_end="pass",
        delays_ns=run_lengths(delays),
        dropped_numbers={"rate": str(by_rate)} if by_rate.ranges else {},
    )
    return _entry(pair, table, also_left_out=RECORDED_DELAY, loss=loss)


def _entry(
    pair: LinkEnds, table: LinkTable, *, also_left_out: set[str], loss: Listed | EarlierRun
) -> LinkEntry:
    kept: Mapping[str, object] = {
        key: value
        for key, value in table
        if key not in LOSES | also_left_out and value != LinkTable.model_fields[key].default
    }
    content = table.content
    if content is not None:
        # A bit error that a receiver notices is a loss.
        ratio = {"bit_error_ratio": 0.0} if content.frame_check else {}
        kept = {**kept, "content": content.model_copy(update=ratio)}
    return LinkEntry(sender=pair[0], receiver=pair[1], loss=loss, **kept)  # type: ignore[arg-type]
