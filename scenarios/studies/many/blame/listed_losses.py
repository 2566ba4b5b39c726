"""A recorded run as a scenario that loses exactly the messages of a list.

Delays, order and content stay the same, because random numbers are keyed by message. For links with
a queue or with changes during the run, the recorded delays replace the laws of the link.
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
"""Keys of a link that cause losses."""
RECORDED_DELAY = {"queue"}
"""Keys to omit for links with recorded delays. The other delay keys stay: vehicles derive from them
what to expect of the link."""


@dataclass(frozen=True)
class LossFreeScenario:
    """A scenario without losses, to which listed losses can be added."""

    scenario: Scenario

    def with_losses(self, lost: Iterable[LostMessage]) -> Scenario:
        numbers = numbers_by_link(lost)
        entries = tuple(
            _with_loss(entry, numbers.get((entry.sender, entry.receiver)))
            for entry in self.scenario.tables.link
        )
        return Scenario(self.scenario.tables.model_copy(update={"link": entries}))

    def smallest(self, lost: Iterable[LostMessage], limit: Limit, description: str) -> Scenario:
        """Return the scenario with these losses and the only limit `limit`."""
        tables = self.with_losses(lost).tables
        changes = {
            "name": f"{tables.name[:20]}_blamed",
            "description": description,
            "limits": limit.table,
        }
        return Scenario(tables.model_copy(update=changes))


def _with_loss(entry: LinkEntry, numbers: NumberSet | None) -> LinkEntry:
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
    changes = [change for change in scenario.tables.change if isinstance(change, LINK_CHANGES)]
    changed = {
        pair
        for change in changes
        for pair in links_of(change, scenario.vehicle_names, scenario.links)
    }
    entries = []
    for pair, table in scenario.links.items():
        recorded = pair in changed or table.queue is not None or isinstance(table.loss, EarlierRun)
        if recorded:
            entries.append(_recorded(run, pair, table))
        else:  # delays are keyed by message number and stay the same
            listed = Listed(kind="listed", lost_numbers="")
            entries.append(_entry(pair, table, also_left_out=set(), loss=listed))
    tables = scenario.tables.model_copy(
        update={
            "overrides": None,
            "links": LinkTable(),
            "link": tuple(entries),
            "change": tuple(
                change for change in scenario.tables.change if not isinstance(change, LINK_CHANGES)
            ),
            "vehicle": {
                name: vehicle.model_copy(update={"transmitter_off": (), "receiver_off": ()})
                for name, vehicle in scenario.tables.vehicle.items()
            },
        }
    )
    return LossFreeScenario(Scenario(tables))


def _recorded(run: RecordedRun, pair: LinkEnds, table: LinkTable) -> LinkEntry:
    """Build the entry of a link with recorded delays.

    Messages still in transit at the end of the run become visible one second later.
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
        # A detected bit error is a loss.
        ratio = {"bit_error_ratio": 0.0} if content.frame_check else {}
        kept = {**kept, "content": content.model_copy(update=ratio)}
    return LinkEntry(sender=pair[0], receiver=pair[1], loss=loss, **kept)  # type: ignore[arg-type]
