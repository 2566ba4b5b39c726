"""`convoy review`: shows a recorded run in Rerun, drawn as it was drawn live."""

from collections.abc import Callable
from pathlib import Path

import click

from scenarios.definition.errors import ScenarioError
from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import Scenario, scenario_from_text
from transport.log.reader import LogReader
from transport.log.records import LogError
from transport.picture.option import RerunOption
from transport.picture.view import RerunView
from transport.topics import CONDUCTOR
from vehicles.messages import RunStart

USUAL_GAP_M = 15.0


def open_view(option: RerunOption, scenario: Scenario, run_id: str) -> RerunView:
    """Open the picture of a run of `scenario`, live or reviewed; its `draw` is a listener."""
    path = scenario.route.path
    return RerunView(
        option,
        run_id=run_id,
        vehicles=scenario.vehicle_names,
        gap_m=widest_gap(scenario),
        path=(path.east.tolist(), path.north.tolist()),
        road_yaw=scenario.route.start_yaw,
        lane_m=scenario.tables.events.lane_width_m,
        title=scenario.title,
    )


def widest_gap(scenario: Scenario) -> float:
    """Return the largest gap (m) between two vehicles, as started with or kept at top speed."""
    gaps = [*scenario.route.gaps[1:], 0.0]
    if scenario.tables.speed.followers == "gap":
        profile = scenario.route.profile
        top = max(profile.at(float(second))[0] for second in range(int(scenario.duration_s) + 2))
        gaps.append(scenario.gap_policy.desired(top))
    return max(gaps) or USUAL_GAP_M


def _to_stderr(line: str) -> None:
    click.echo(line, err=True)


def review(
    log: Path,
    option: RerunOption,
    *,
    wait: Callable[[str], None],
    warn: Callable[[str], None] = _to_stderr,
) -> int:
    """Draw the run recorded in `log`; returns the number of messages drawn.

    The log alone is enough; `warn` is called with a line about each fault of it. While
    the picture is served from here, `wait` is called with where to look, once all is drawn, and
    must return when the picture is no longer looked at. Raises LogError or ViewerError.
    """
    reader = LogReader(log)
    if reader.truncated:
        warn(f"{log}: breaks off; what was written before is shown")
    if reader.damage:
        warn(reader.damage)
    with _open(reader, option, warn) as view:
        count = 0
        for now, _, message in reader.messages():
            view.draw(now, message)
            count += 1
        if option.sink == "serve":
            wait(view.where)
    return count


def _open(reader: LogReader, option: RerunOption, warn: Callable[[str], None]) -> RerunView:
    starts = (message for _, _, message in reader.messages(topics=("start",)))
    run_id = next((m.run_id for m in starts if isinstance(m, RunStart)), reader.path.stem)
    text = reader.attachments().get(ATTACHED_AS)
    if text is not None:
        try:
            return open_view(option, scenario_from_text(text.decode(), label="scenario"), run_id)
        except (
            ScenarioError,
            UnicodeDecodeError,
        ) as error:  # damaged, or written by another version: its road is unknown
            warn(f"{reader.path}: the road is left out: {error}")
    return RerunView(option, run_id=run_id, vehicles=_in_order(reader))


def _in_order(reader: LogReader) -> list[str]:
    """Names of the vehicles; first the lead, which receives from no other."""
    vehicles = [name for name in reader.vehicles if name != CONDUCTOR]
    if not vehicles:
        raise LogError(f"{reader.path}: holds no vehicle's messages")
    return sorted(vehicles, key=lambda name: (reader.counts.get((name, "verdict"), 0) > 0, name))
