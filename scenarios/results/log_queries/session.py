"""The scenario that repeats a recorded run, including the changes made by hand."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from scenarios.definition.changing.link_changes import LINK_CHANGES, links_of
from scenarios.definition.changing.live_change import change_from_json
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.definition.schema.change_tables import AnyChange, VehicleChangeTable
from scenarios.definition.schema.limit_tables import DEADLINES
from scenarios.definition.schema.replay_table import ReplayTable
from scenarios.results.log_summary import PARTIAL, scenario_in
from transport.log.errors import LogError
from transport.log.reader import LogReader
from vehicles.messages import Change, RunStart
from vehicles.schedule import SECOND

USED = ("start", "change")
"""Topics that repeat a run."""


@dataclass(slots=True)
class _LiveChange:
    """A change made by hand, and the vehicles that carried it out."""

    change: AnyChange
    by: list[str] = field(default_factory=list)


def session_of(
    log: Path, warn: Callable[[str], None] = lambda _: None, *, partial: bool = False
) -> Scenario:
    """The scenario in `log` with the changes made by hand; raises LogError.

    Equal changes of several receivers at one instant are one change. A log from which changes may
    be missing, because it is damaged or incomplete, is refused unless `partial`; `warn`
    gets a line about it.
    """
    reader = LogReader(log)
    if not partial:
        reader.refuse_faults(*USED, remedy=PARTIAL)
    if faults := reader.faults_in(USED) or reader.faults:
        warn(faults)
    scenario = scenario_in(reader)
    start_at: int | None = None
    done: dict[tuple[int, str], _LiveChange] = {}
    for _, _, message in reader.messages(USED):
        if isinstance(message, RunStart):
            start_at = message.start_at_ns
        elif isinstance(message, Change) and message.by_hand:
            if start_at is None:
                raise LogError(f"{log}: a change before the start of the run")
            at = message.effective_at_ns, message.table
            change = change_from_json(message.table)
            exact = change.model_copy(update={"at_s": (at[0] - start_at) / SECOND})
            done.setdefault(at, _LiveChange(exact)).by.append(message.vehicle)
    made = sorted(done.items(), key=lambda entry: entry[0][0])
    added = [change for _, done in made for change in _as_carried_out(done, scenario)]
    update = {"change": (*scenario.tables.change, *added)} if added else {}
    changed = scenario.tables.model_copy(update=update)
    # Parsed again, which checks it.
    return scenario_from_text(Scenario(changed).text, label=f"{log} (with its changes)")


def replayed_session(
    log: Path,
    vehicles: Sequence[str],
    overrides: Sequence[str] = (),
    seed: int | None = None,
    *,
    warn: Callable[[str], None] = lambda _: None,
    partial: bool = False,
) -> Scenario:
    """The session of `log` in which `vehicles` send their recorded messages again.

    Their changes and limits are left out: the messages contain the changes, and replayed vehicles
    decide nothing. Raises LogError, or ScenarioError for an invalid vehicle or override.
    """
    tables = session_of(log, warn, partial=partial).tables
    replay = ReplayTable.model_construct(  # checked below, as the other tables
        log=str(log.resolve()), vehicles=tuple(vehicles), partial=partial
    )
    update: dict[str, object] = {"replay": replay}
    if tables.change:
        update["change"] = tuple(
            change
            for change in tables.change
            if not isinstance(change, VehicleChangeTable) or change.vehicle not in vehicles
        )
    limits = {
        name: tuple(one for one in given if one.vehicle not in vehicles)
        for name in DEADLINES
        if (given := getattr(tables.limits, name))
    }
    if limits:
        update["limits"] = tables.limits.model_copy(update=limits)
    text = Scenario(tables.model_copy(update=update)).text
    return scenario_from_text(text, label=str(log), overrides=overrides, seed=seed)


def _as_carried_out(done: _LiveChange, scenario: Scenario) -> Sequence[AnyChange]:
    """One change, or one per receiver if not all of them carried it out."""
    change = done.change
    if not isinstance(change, LINK_CHANGES):
        return [change]
    about = {to for _, to in links_of(change, scenario.vehicle_names, scenario.links)}
    if about == set(done.by):
        return [change]
    return [change.model_copy(update={"receiver": receiver}) for receiver in done.by]
