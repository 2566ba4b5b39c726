"""Events and figures of the user's classes, from the true poses of each vehicle."""

from collections.abc import Iterable, Iterator, Sequence

from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.plug_ins.guards import PlugInError
from scenarios.definition.schema.plug_ins.measures import EventDetector, RunFigure
from scenarios.definition.schema.plug_ins.table import PlugInTable
from scenarios.results.events.encounters import Episode
from vehicles.messages import TruePose
from vehicles.schedule import SECOND


class OwnMeasures:
    """Detectors and figures of all vehicles; one that fails is left out, with a line in `faults`.

    A class that measures must not end a run.
    """

    def __init__(
        self,
        vehicles: Sequence[str],
        events: Sequence[PlugInTable] = (),
        figures: Sequence[PlugInTable] = (),
    ) -> None:
        self._detectors: dict[str, dict[str, EventDetector]] = {
            name: {table.class_name: table.build() for table in events} for name in vehicles
        }
        self._figures: dict[str, dict[str, RunFigure]] = {
            name: {table.class_name: table.build() for table in figures} for name in vehicles
        }
        self._has_any = bool(events or figures)
        self._open: dict[tuple[str, str], Episode] = {}
        self.faults: list[str] = []

    @classmethod
    def of(cls, scenario: Scenario) -> "OwnMeasures | None":
        """Measures of a scenario whose classes are here; None without any."""
        tables = scenario.tables
        if not tables.event and not tables.figure:
            return None
        try:
            return cls(scenario.vehicle_names, tables.event, tables.figure)
        except PlugInError:  # of a recorded run
            return None

    def add(self, pose: TruePose) -> Iterable[Episode]:
        """Take a true pose; returns the events that begin."""
        return list(self._measured(pose)) if self._has_any else ()

    def _measured(self, pose: TruePose) -> Iterator[Episode]:
        vehicle, at = pose.vehicle, pose.true_at_ns
        figures, detectors = self._figures[vehicle], self._detectors[vehicle]
        for name, figure in list(figures.items()):
            try:
                figure.add(pose)
            except PlugInError as error:
                self._leave_out(figures, vehicle, name, error)
        for name, detector in list(detectors.items()):
            try:
                holds = detector.holds(pose)
            except PlugInError as error:
                self._leave_out(detectors, vehicle, name, error)
                continue
            if not holds:
                continue
            episode = self._open.get((vehicle, name))
            if episode is None or episode.is_over(at):
                place = (pose.east_m, pose.north_m)
                episode = Episode("own", (vehicle,), at, at, place=place, name=name)
                self._open[vehicle, name] = episode
                yield episode
            episode.until_ns = at
            episode.most("duration_s", (at - episode.at_ns) / SECOND)

    def values(self, vehicle: str) -> dict[str, float | None]:
        """Figures of a vehicle by the names of their classes, without those that failed."""
        figures = self._figures.get(vehicle, {})
        result: dict[str, float | None] = {}
        for name, figure in list(figures.items()):
            try:
                result[name] = figure.value()
            except PlugInError as error:
                self._leave_out(figures, vehicle, name, error)
        return result

    def _leave_out(
        self,
        measures: dict[str, RunFigure] | dict[str, EventDetector],
        vehicle: str,
        name: str,
        error: PlugInError,
    ) -> None:
        del measures[name]
        self.faults.append(f"{vehicle}: {error}; left out from then on")
