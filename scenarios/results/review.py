"""Draws a recorded run with its true errors, gaps and events in Rerun.

Import this module only for a picture: it loads Rerun, an extra.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import click
import numpy as np

from scenarios.definition.scenario import Scenario
from scenarios.results.events import Event
from scenarios.results.log_summary import scenario_in, tables_in
from scenarios.results.run_event import events
from scenarios.results.tables import RunTables, Signal, Tables
from scenarios.results.true_motion import sizes_of
from scenarios.results.vehicle_figures import true_errors, true_gaps
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.picture.batch import DRAWN_TOPICS, Batch, Mark, RunScene, VehicleValues
from transport.picture.option import RerunOption, require_cursor
from transport.picture.view import RerunView
from transport.topics import RUN_SENDER
from vehicles.schedule import SECOND

DEFAULT_SPACING_M = 15.0
LATEST = 2**62


def batch_of(
    run: RunTables,
    marked: Sequence[Event],
    tables: Tables,
    span: tuple[int, int],
    vehicles: Collection[str],
) -> Batch:
    """Batch of a picture: `tables`, `marked` events, and errors and gaps of `vehicles`.

    Errors and gaps are those from `span[0]` to before `span[1]` (ns).
    """
    names = [name for name in run.followers if name in vehicles]
    return Batch(
        start_ns=run.beginning,
        tables=tables,
        errors=_values(run, true_errors, names, span),
        gaps=_values(run, true_gaps, names, span),
        marks=[Mark(event.kind, event.at_ns, event.place, event.vehicles) for event in marked],
    )


def _values(
    run: RunTables,
    signal: Callable[[RunTables, str], Signal],
    names: Sequence[str],
    span: tuple[int, int],
) -> dict[str, VehicleValues]:
    found = {}
    for name in names:
        at, values = signal(run, name)
        rows = (at >= span[0]) & (at < span[1]) & ~np.isnan(values)
        if rows.any():
            found[name] = VehicleValues(at[rows], values[rows])
    return found


def scene_of(scenario: Scenario, vehicles: Sequence[str]) -> RunScene:
    """RunScene of some vehicles of a scenario, lead first."""
    path = scenario.route.path
    return RunScene(
        vehicles=vehicles,
        convoy=scenario.vehicle_names,
        spacing_m=widest_spacing(scenario),
        cars=sizes_of(scenario),
        path=(path.east.tolist(), path.north.tolist()),
        lane_m=scenario.tables.events.lane_width_m,
        duration_s=scenario.duration_s,
    )


def recording_id(log: Path) -> str:
    """Name under which a viewer keeps the run of a log apart from all others.

    Runs of one scenario and seed differ in their folders, and folders of one name in their paths.
    """
    path = log.resolve()
    return f"{path.parent.name}/{path.stem}-{crc32(str(path).encode()):08x}"


def widest_spacing(scenario: Scenario) -> float:
    """Largest spacing (m) of two vehicles, at the start or at top speed."""
    spacings = [*scenario.route.spacings[1:], 0.0]
    if scenario.tables.speed.followers == "gap":
        profile = scenario.route.profile
        top = max(profile.at(float(second))[0] for second in range(int(scenario.duration_s) + 2))
        places = range(1, len(scenario.vehicle_names))
        spacings += [scenario.spacing_policy(place).desired(top) for place in places]
    return max(spacings) or DEFAULT_SPACING_M


# ---- `convoy review`: shows a recorded run as it was drawn live


SPAN_NS = 30 * SECOND
"""Time of a log that is read and drawn at once; limits the memory."""


class Excerpt(NamedTuple):
    """Part of a run to draw: seconds from its start, and vehicles besides the lead (None: all)."""

    from_s: float | None = None
    to_s: float | None = None
    vehicles: Sequence[str] | None = None

    def span(self, start: int, reader: LogReader) -> tuple[int, int]:
        """First and last instant (ns) of a run that began at `start`; LogError without records."""
        first = -LATEST if self.from_s is None else start + round(self.from_s * SECOND)
        last = LATEST if self.to_s is None else start + round(self.to_s * SECOND)
        if first > last or first > reader.last_at or last < start:
            end_s = (reader.last_at - start) / SECOND
            raise LogError(
                f"{reader.path}: nothing is recorded from {self.from_s or 0.0:g} to "
                f"{end_s if self.to_s is None else self.to_s:g} s; the log ends at {end_s:.2f} s"
            )
        return first, last


WHOLE_RUN, to_stderr = Excerpt(), partial(click.echo, err=True)


def review(
    log: Path,
    option: RerunOption,
    *,
    wait: Callable[[str], None],
    warn: Callable[[str], None] = to_stderr,
    excerpt: Excerpt = WHOLE_RUN,
    progress: Callable[[float], None] = lambda _: None,
    at_s: float | None = None,
) -> int:
    """Draw the run recorded in `log`, or part of it; returns the number of messages drawn.

    With `at_s` the viewer's cursor is moved to that time (s) after the start. `progress` gets the
    share that is done, and `warn` a line about faults of the log and missing parts. A served
    picture is shown until `wait` returns, which is called with its address when all is drawn.
    Raises LogError or ViewerError.
    """
    if at_s is not None:
        require_cursor(option)
    reader = LogReader(log)
    if reader.faults:
        warn(reader.faults)
    scenario = scenario_in(reader)
    convoy = list(scenario.vehicle_names)
    if unknown := set(excerpt.vehicles or ()).difference(convoy):
        names = ", ".join(sorted(unknown))
        raise LogError(f"{log}: holds no vehicle {names}; it has {', '.join(convoy)}")
    if excerpt.vehicles is not None:
        shown = [name for name in convoy if name == convoy[0] or name in excerpt.vehicles]
        excerpt = excerpt._replace(vehicles=shown)
    scene = scene_of(scenario, excerpt.vehicles or convoy)
    with RerunView(
        option, recording_id=recording_id(log), scene=scene, title=scenario.title
    ) as view:
        count = 0
        for batch, share in batches(reader, scenario, excerpt):
            view.draw(batch)
            count += sum(map(len, batch.tables.values()))
            progress(share)
        view.finish()
        if at_s is not None:
            view.show_at(at_s)
        if option.sink == "serve":
            wait(view.destination)
    return count


def batches(
    reader: LogReader, scenario: Scenario, excerpt: Excerpt = WHOLE_RUN
) -> Iterator[tuple[Batch, float]]:
    """Yield part of a run in batches, each with the share of the run that has been yielded.

    Its errors and events need the messages from the start of the run on. Raises LogError.
    """
    run = tables_in(reader, scenario)
    start, found = run.beginning, events(run)
    first, last = excerpt.span(start, reader)
    vehicles = None if excerpt.vehicles is None else {*excerpt.vehicles, RUN_SENDER}
    shown = vehicles or {*run.names}
    begin = max(first, min(reader.first_at, start))
    while begin <= min(reader.last_at, last):
        end = max(begin, start) + SPAN_NS
        span = begin, min(end - 1, last)
        tables = reader.columns(DRAWN_TOPICS, vehicles=vehicles, span_ns=span)
        new = [
            event
            for event in found
            if span[0] <= event.at_ns <= span[1] and not shown.isdisjoint(event.vehicles)
        ]
        batch = batch_of(run, new, tables, (span[0], span[1] + 1), shown)
        yield batch, min((end - start) / max(reader.last_at - start, 1), 1.0)
        begin = end
