"""Events and metrics of the user's functions."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from scenarios.definition.schema.plug_ins.point import PlugInError, called
from scenarios.definition.schema.plug_ins.table import PlugInTable
from scenarios.results.events import Event, place_at
from scenarios.results.tables import RunTables, once
from vehicles.schedule import SECOND


@dataclass(slots=True)
class OwnMeasures:
    """Results of the user's functions; one that fails is left out, with a line in `faults`.

    `figures` are values by vehicle and function. A function that measures does not end a run.
    """

    figures: dict[str, dict[str, float | None]] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


@once
def own_measures(run: RunTables) -> OwnMeasures:
    """Results of all functions of the scenario; nothing of those that are not here."""
    tables = run.scenario.tables
    found = OwnMeasures({name: {} for name in run.names} if tables.figure else {})
    for table in (*tables.figure, *tables.event):
        measure = _add_figure if table in tables.figure else _add_events
        try:
            measure(found, run, table)
        except PlugInError as error:
            found.faults += [f"{error}; left out"] if callable(table.plugged) else []
    return found


def _add_figure(found: OwnMeasures, run: RunTables, table: PlugInTable) -> None:
    result = table.build(run)
    by_name = result if isinstance(result, Mapping) else dict.fromkeys(run.names, result)
    _refuse_unknown(run, table, by_name)
    for name, value in by_name.items():
        found.figures[name][table.word] = None if value is None else float(value)


def _add_events(found: OwnMeasures, run: RunTables, table: PlugInTable) -> None:
    what = table.point.what(table.use)
    held = called(lambda: [(name, int(at), int(to)) for name, at, to in table.build(run)], what)
    _refuse_unknown(run, table, (name for name, _, _ in held))
    for name, at, to in held:
        figures = {"duration_s": (to - at) / SECOND}
        place = place_at(run.table(name, "truth"), at)
        found.events.append(Event("own", (name,), at, figures, place, table.word))


def _refuse_unknown(run: RunTables, table: PlugInTable, names: Iterable[object]) -> None:
    if unknown := ", ".join(map(str, set(names).difference(run.names))):
        what = table.point.what(table.use)
        raise PlugInError(f"{what} returned vehicles {unknown}, expected {', '.join(run.names)}")


def own_events(run: RunTables) -> Sequence[Event]:
    return own_measures(run).events
