"""`convoy review`: shows a recorded run in Rerun as it was drawn live."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import click

from scenarios.definition.errors import ScenarioError
from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import Scenario
from scenarios.results.log_summary import scenario_in, tables_in
from scenarios.results.run_drawing import LATEST, batch_of, open_view, recording_id
from scenarios.results.run_event import events
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.picture.batch import DRAWN_TOPICS, Batch, RunScene
from transport.picture.option import RerunOption, require_cursor
from transport.picture.view import RerunView
from transport.topics import RUN_SENDER, valid_at
from vehicles.schedule import SECOND

SPAN_NS = 30 * SECOND
"""Time of a log that is read and drawn at once; limits the memory."""


def _to_stderr(line: str) -> None:
    click.echo(line, err=True)


class Excerpt(NamedTuple):
    """Part of a run to draw: seconds from its start, and vehicles (None: all)."""

    from_s: float | None = None
    to_s: float | None = None
    vehicles: Sequence[str] | None = None

    def with_lead(self, convoy: Sequence[str], log: Path) -> "Excerpt":
        """The same with the lead, in the order of the convoy; raises LogError for other names."""
        if self.vehicles is None:
            return self
        if unknown := set(self.vehicles) - set(convoy):
            names = ", ".join(sorted(unknown))
            raise LogError(f"{log}: holds no vehicle {names}; it has {', '.join(convoy)}")
        chosen = [name for name in convoy if name == convoy[0] or name in self.vehicles]
        return self._replace(vehicles=chosen)

    def check(self, start: int, reader: LogReader) -> None:
        """Raise LogError if nothing was recorded in this part of a run that began at `start`."""
        first, last = self.span(start)
        if first > last or first > reader.last_at or last < start:
            end_s = (reader.last_at - start) / SECOND
            raise LogError(
                f"{reader.path}: nothing is recorded from {self.from_s or 0.0:g} to "
                f"{end_s if self.to_s is None else self.to_s:g} s; the log ends at {end_s:.2f} s"
            )

    def span(self, start: int) -> tuple[int, int]:
        """First and last instant (ns) of a run that began at `start`."""
        first = -LATEST if self.from_s is None else start + round(self.from_s * SECOND)
        last = LATEST if self.to_s is None else start + round(self.to_s * SECOND)
        return first, last


WHOLE_RUN = Excerpt()


def review(
    log: Path,
    option: RerunOption,
    *,
    wait: Callable[[str], None],
    warn: Callable[[str], None] = _to_stderr,
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
    scenario = _scenario_in(reader, warn)
    names = _in_order(reader) if scenario is None else list(scenario.vehicle_names)
    excerpt = excerpt.with_lead(names, reader.path)
    with _open(reader, option, scenario, names, excerpt) as view:
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
    reader: LogReader, scenario: Scenario | None, excerpt: Excerpt = WHOLE_RUN
) -> Iterator[tuple[Batch, float]]:
    """Yield part of a run in batches, each with the share of the run that has been yielded.

    Its errors and events need the messages from the start of the run on. Raises LogError.
    """
    start = _start_of(reader)
    excerpt.check(start, reader)
    first, last = excerpt.span(start)
    run = None if scenario is None else tables_in(reader, scenario)
    found = () if run is None else events(run)
    vehicles = None if excerpt.vehicles is None else {*excerpt.vehicles, RUN_SENDER}
    begin = max(first, min(reader.first_at, start))
    while begin <= min(reader.last_at, last):
        end = max(begin, start) + SPAN_NS
        span = begin, min(end - 1, last)
        tables = reader.columns(DRAWN_TOPICS, vehicles=vehicles, span_ns=span)
        batch = Batch(start_ns=start, tables=tables)
        if run is not None:
            shown = vehicles or {*run.names}
            new = [
                event
                for event in found
                if span[0] <= event.at_ns <= span[1] and not shown.isdisjoint(event.vehicles)
            ]
            batch = batch_of(run, new, tables, (span[0], span[1] + 1), shown)
        yield batch, min((end - start) / max(reader.last_at - start, 1), 1.0)
        begin = end


def _start_of(reader: LogReader) -> int:
    """Start of a run (ns) or, if it was not recorded, the first true pose."""
    starts = (valid_at(message) for _, _, message in reader.messages(("start", "truth")))
    return next(starts, 0)


def _scenario_in(reader: LogReader, warn: Callable[[str], None]) -> Scenario | None:
    if ATTACHED_AS not in reader.attachments():
        return None
    try:
        return scenario_in(reader)
    except (LogError, ScenarioError) as error:  # damaged, or of another version
        warn(f"{reader.path}: road, true errors, gaps and events are left out: {error}")
        return None


def _open(
    reader: LogReader,
    option: RerunOption,
    scenario: Scenario | None,
    names: Sequence[str],
    excerpt: Excerpt,
) -> RerunView:
    log = reader.path
    if scenario is not None:
        return open_view(option, scenario, log, vehicles=excerpt.vehicles)
    scene = RunScene(vehicles=excerpt.vehicles or names, convoy=names)
    return RerunView(option, recording_id=recording_id(log), scene=scene)


def _in_order(reader: LogReader) -> list[str]:
    """Names of the vehicles, the lead first: it has no verdicts on received messages."""
    vehicles = [name for name in reader.vehicles if name != RUN_SENDER]
    if not vehicles:
        raise LogError(f"{reader.path}: holds no vehicle's messages")
    return sorted(vehicles, key=lambda name: (reader.counts.get((name, "verdict"), 0) > 0, name))
