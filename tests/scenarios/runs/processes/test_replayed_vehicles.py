"""Vehicles that send recorded messages, as processes on the wall clock."""

from pathlib import Path

from scenarios.definition.scenario import load_scenario
from scenarios.results.files import LOG_NAME
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.scenarios.runs.simulation.plan import Plan
from tests.scenarios.runs.simulation.world import BASE, World
from transport.log.reader import LogReader
from vehicles.messages import GpsPose, TruePose

OVERRIDES = (*BASE, "convoy.vehicles=3", "duration_s=1", "links.loss_ratio=0.3")


def poses(log: Path, vehicle: str) -> tuple[list[bytes], list[tuple[float, ...]]]:
    """Bytes of the received-over-links content of poses, and the true states, of a vehicle."""
    messages = [m for _, _, m in LogReader(log).messages(("gps", "truth"), (vehicle,))]
    sent = [m for m in messages if isinstance(m, GpsPose)]
    truth = [m for m in messages if isinstance(m, TruePose)]
    return (
        [f"{m.seq} {m.latitude_deg} {m.longitude_deg} {m.mode}".encode() for m in sent],
        [(m.seq, m.east_m, m.north_m, m.steering_rad) for m in truth],
    )


def test_live_processes_behind_a_replayed_one_drive_as_in_the_recorded_run(
    tmp_path: Path,
) -> None:
    run_virtual(load_scenario("lane_change", OVERRIDES), tmp_path, Stop())
    log = tmp_path / LOG_NAME
    replay = (f"replay.log={log}", 'replay.vehicles=["v1", "v2"]', "links.loss_ratio=0.3")
    world = World(Plan(seed=0, vehicles=3, variant=replay), tmp_path / "wall")
    world.run()
    again = world.folder / LOG_NAME
    assert LogReader(again).faults == ""
    assert ("v1", "command") not in LogReader(again).counts
    for name in ("v1", "v2", "v3"):
        assert poses(again, name) == poses(log, name)
