"""`convoy review`: shows a recorded run in Rerun, drawn as it was drawn live."""

from collections.abc import Callable
from pathlib import Path

from scenarios.scenario import Scenario, scenario_from_text
from transport.mcap_log import LogError, LogReader
from transport.rerun_view import RerunOption, RerunView
from transport.topics import CONDUCTOR
from vehicles.messages import RunStart

SCENARIO_FILE = "scenario.toml"
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
    )


def widest_gap(scenario: Scenario) -> float:
    """Return the largest gap (m) between two vehicles, as started with or kept at top speed."""
    speed = scenario.tables.speed
    gaps = [*scenario.route.gaps[1:], 0.0]
    if speed.followers == "gap":
        profile = scenario.route.profile
        top = max(profile.at(float(second))[0] for second in range(int(scenario.duration_s) + 2))
        gaps.append(speed.gap.standstill_m + speed.gap.headway_s * top)
    return max(gaps) or USUAL_GAP_M


def review(log: Path, option: RerunOption, *, wait: Callable[[str], None]) -> int:
    """Draw the run recorded in `log`; returns the number of messages drawn.

    The log alone is enough: the road is that of the scenario inside it, or is left out if there
    is none. While the picture is served from here, `wait` is called with where to look, and
    must return when nobody looks any more. Raises LogError or ViewerError.
    """
    reader = LogReader(log)
    with _open(reader, option) as view:
        count = 0
        for now, _, message in reader.messages():
            view.draw(now, message)
            count += 1
        if option.sink == "serve":
            wait(view.where)
    return count


def _open(reader: LogReader, option: RerunOption) -> RerunView:
    starts = reader.messages(topics=("start",))
    run_id = next((m.run_id for _, _, m in starts if isinstance(m, RunStart)), reader.path.stem)
    text = reader.attachments().get(SCENARIO_FILE)
    if text is not None:
        scenario = scenario_from_text(text.decode(), label=str(reader.path))
        return open_view(option, scenario, run_id)
    vehicles = [name for name in reader.vehicles if name != CONDUCTOR]
    if not vehicles:
        raise LogError(f"{reader.path}: holds no vehicle's messages")
    vehicles.sort(key=lambda name: (reader.counts.get((name, "verdict"), 0) > 0, name))
    return RerunView(option, run_id=run_id, vehicles=vehicles)
