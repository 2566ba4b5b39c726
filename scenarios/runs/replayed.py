"""The scenario that repeats a recorded run, including the changes made by hand."""

from collections.abc import Callable, Sequence
from pathlib import Path

from scenarios.definition.changes import LINK_CHANGES, change_from_json, links_of
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.definition.schema.change_tables import AnyChange, VehicleChangeTable
from scenarios.definition.schema.limit_tables import DEADLINES
from scenarios.definition.schema.scenario_tables import ReplayTable
from scenarios.results.log_summary import PARTIAL, scenario_in
from scenarios.results.summary import MadeChange, made_changes
from scenarios.results.tables import RunTables
from transport.log.errors import LogError
from transport.log.reader import LogReader

USED = ("start", "change")
"""Topics that repeat a run."""


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
    run = RunTables(scenario, reader.columns(USED))
    made = [change for change in made_changes(run) if change.by_hand]
    if made and run.start_at is None:
        raise LogError(f"{log}: a change before the start of the run")
    added = [one for change in made for one in _as_carried_out(change, run, scenario)]
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


def _as_carried_out(made: MadeChange, run: RunTables, scenario: Scenario) -> Sequence[AnyChange]:
    """One change, or one per receiver if not all of them carried it out."""
    change = change_from_json(made.table)
    exact = change.model_copy(update={"at_s": run.seconds(made.at_ns)})
    if not isinstance(change, LINK_CHANGES):
        return [exact]
    about = {to for _, to in links_of(change, scenario.vehicle_names, scenario.links)}
    if about == set(made.vehicles):
        return [exact]
    return [exact.model_copy(update={"receiver": receiver}) for receiver in made.vehicles]
