"""`convoy review`: shows a recorded run in Rerun as it was drawn live."""

from collections.abc import Callable
from pathlib import Path

import click

from scenarios.definition.errors import ScenarioError
from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import Scenario
from scenarios.results.events.bodies import BodySize
from scenarios.results.files import SUMMARY_NAME
from scenarios.results.log_summary import scenario_in
from scenarios.results.pictures.log_drawing import WHOLE_RUN, Excerpt, LogDrawing
from scenarios.results.pictures.run_drawing import open_view, recording_id
from scenarios.results.stream import FigureStream
from scenarios.results.summary import from_json
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.picture.option import RerunOption, require_cursor
from transport.picture.view import RerunView
from transport.topics import RUN_SENDER
from vehicles.car.parameters import LINCOLN_MKZ


def _to_stderr(line: str) -> None:
    click.echo(line, err=True)


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
    stream = _stream(reader, scenario)
    excerpt = excerpt.with_lead(list(stream.sizes), reader.path)
    with _open(reader, option, scenario, stream, excerpt) as view:
        drawing = LogDrawing(reader, view, stream, has_events=_may_have_events(reader))
        count = drawing.draw(excerpt, progress) if view.enabled else 0
        view.finish()
        if at_s is not None:
            view.show_at(at_s)
        if option.sink == "serve":
            wait(view.destination)
    return count


def _stream(reader: LogReader, scenario: Scenario | None) -> FigureStream:
    if scenario is not None:
        return FigureStream.of(scenario)
    return FigureStream(dict.fromkeys(_in_order(reader), BodySize.of(LINCOLN_MKZ)))


def _may_have_events(reader: LogReader) -> bool:
    """Whether the run may have had events: unless the summary of a complete log lists none."""
    summary = reader.attachments().get(SUMMARY_NAME)
    if summary is None or reader.faults:
        return True
    try:
        return bool(from_json(summary.decode()).events)
    except ValueError:
        return True


def _scenario_in(reader: LogReader, warn: Callable[[str], None]) -> Scenario | None:
    if ATTACHED_AS not in reader.attachments():
        return None
    try:
        return scenario_in(reader)
    except (LogError, ScenarioError) as error:  # damaged, or of another version
        warn(f"{reader.path}: the road is left out: {error}")
        return None


def _open(
    reader: LogReader,
    option: RerunOption,
    scenario: Scenario | None,
    stream: FigureStream,
    excerpt: Excerpt,
) -> RerunView:
    log = reader.path
    if scenario is not None:
        return open_view(option, scenario, log, vehicles=excerpt.vehicles, of_log=True)
    names = list(stream.sizes)
    return RerunView(
        option,
        recording_id=recording_id(log),
        vehicles=excerpt.vehicles or names,
        convoy=names,
        of_log=True,
    )


def _in_order(reader: LogReader) -> list[str]:
    """Names of the vehicles, the lead first: it has no verdicts on received messages."""
    vehicles = [name for name in reader.vehicles if name != RUN_SENDER]
    if not vehicles:
        raise LogError(f"{reader.path}: holds no vehicle's messages")
    return sorted(vehicles, key=lambda name: (reader.counts.get((name, "verdict"), 0) > 0, name))
