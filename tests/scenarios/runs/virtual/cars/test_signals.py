"""Convoys with each receiver and each rule of sending: they drive, twice alike to the byte."""

from itertools import pairwise
from pathlib import Path

import pytest

from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from scenarios.results.log_summary import summary_of
from scenarios.results.summary import RunSummary
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_unlogged, run_virtual
from tests.made.scenarios.messages import STRAIGHT
from transport.log.reader import LogReader
from vehicles.messages import GpsPose, LinkVerdict
from vehicles.schedule import SECOND

STATES = "gnss.fix_states={kind='chain', transitions=[{state='fixed', to='float', mean_s=1.0}]}"
TUNNEL = "gnss.outages=[{kind='road', from_m=20.0, to_m=50.0}]"
PROFILE = "sending={kind='profile', profile=[{at_s=0.0, rate_hz=20.0}, {at_s=2.0, rate_hz=7.0}]}"
CASES = {
    "rtk_fixed": ("gnss.preset=rtk_fixed",),
    "rtk_float": ("gnss.preset=rtk_float",),
    "single": ("gnss.preset=single",),
    "no fix at all": ("gnss.preset=none",),
    "one without a fix": ("vehicle.v1.gnss.preset=none",),
    "states": (STATES, "gnss.while_float.accuracy_ratio=0.05"),
    "tunnel": (TUNNEL,),
    "late": ("gnss.latency_ms=130", "gnss.quantisation_m=0.01"),
    "common": ("gnss.common_drift.deviation_m=2.0", "gnss.bias.deviation_m=0.01"),
    "fixed rate": ("sending={kind='fixed', rate_hz=7.0, phase_s=0.013}", "links.rate_hz=3.5"),
    "drawn phase": ("sending={kind='fixed', rate_hz=10.0, drawn_phase=true}",),
    "profile": (PROFILE,),
    "cam": ("sending={kind='cam', drawn_phase=true}",),
    "vw": ("sending={kind='intervals', table='cam_vw_highway'}",),
    "renault": ("sending={kind='intervals', table='cam_renault_highway'}",),
    "busy": ("sending.kind=every_fix", "sending.dcc.busy=[{at_s=1.0, busy_ratio=0.5}]"),
    "one of them": ("vehicle.v2.sending.kind=cam", "vehicle.v2.gnss.preset=rtk_float"),
}


def made(*changes: str, seconds: float = 4.0) -> Scenario:
    return scenario_from_text(STRAIGHT, overrides=[f"duration_s={seconds}", *changes])


def ran(scenario: Scenario, folder: Path) -> RunSummary:
    return run_virtual(scenario, folder, Stop())


def poses(folder: Path, vehicle: str) -> list[GpsPose]:
    read = LogReader(folder / "run.mcap").messages(topics=("gps",))
    return [one for _, _, one in read if isinstance(one, GpsPose) and one.vehicle == vehicle]


def log(folder: Path) -> bytes:
    return (folder / "run.mcap").read_bytes()


@pytest.mark.spread(3)
@pytest.mark.parametrize("changes", CASES.values(), ids=CASES)
def test_it_drives_and_the_same_again(changes: tuple[str, ...], tmp_path: Path) -> None:
    scenario = made(*changes, "convoy.vehicles=3", seconds=2.5)
    summary = ran(scenario, tmp_path / "one")
    assert (summary.outcome, summary.holes) == ("completed", ())
    assert not summary.recorder_rejected_messages
    assert all(row.rejected_messages == row.missing_poses == 0 for row in summary.vehicles)
    again = scenario_from_text(scenario.text)
    assert again.tables == scenario.tables
    ran(again, tmp_path / "two")
    assert log(tmp_path / "one") == log(tmp_path / "two")
    assert summary_of(tmp_path / "one" / "run.mcap") == summary
    for vehicle in scenario.vehicle_names:
        sent = poses(tmp_path / "one", vehicle)
        assert [one.seq for one in sent] == list(range(len(sent)))
        for before, after in pairwise(sent):
            assert before.sent_at_ns < after.sent_at_ns
            assert before.measured_at_ns < after.measured_at_ns
        assert all(one.measured_at_ns <= one.sent_at_ns for one in sent)


def test_instants_of_sending_are_their_own(tmp_path: Path) -> None:
    """13 ms after the start and every 1/7 s: neither control nor receiver has those instants."""
    scenario = made(*CASES["fixed rate"])
    ran(scenario, tmp_path)
    start = scenario.start_at_ns
    sent = [one.sent_at_ns - start for one in poses(tmp_path, "v2")]
    assert sent == [13_000_000 + round(k * SECOND / 7) for k in range(28)]
    read = LogReader(tmp_path / "run.mcap").messages(topics=("verdict",))
    verdicts = [one for _, _, one in read if isinstance(one, LinkVerdict) and one.vehicle == "v2"]
    assert {one.pose_seq % 2 for one in verdicts if one.outcome == "delivered"} == {0}
    assert {one.reason for one in verdicts if one.pose_seq % 2} == {"rate"}


def test_late_fixes_cost_little() -> None:
    """A tenth of a second is 3 m at 30 m/s: not taken for its own place by any car."""
    found = {}
    for latency in (0, 100):
        scenario = load_scenario(
            "lane_change", ["duration_s=12", "convoy.vehicles=3", f"gnss.latency_ms={latency}"]
        )
        summary = run_unlogged(scenario)
        found[latency] = max(row.cross_track_error_m_max or 0.0 for row in summary.vehicles)
    assert found[100] < found[0] + 0.05


def test_a_common_error_moves_no_vehicle_relative_to_another() -> None:
    """Followers of a lead that strays by metres stray with it; errors of their own part them.

    A convoy is no point: the error drifts on by a decimetre while the last car comes to where the
    lead was.
    """
    found = {}
    for key, deviation in (("common_drift", 0.0), ("common_drift", 3.0), ("drift", 3.0)):
        change = f"gnss.{key}={{deviation_m={deviation}, time_constant_s=10000.0}}"
        scenario = load_scenario("lane_change", ["duration_s=12", "convoy.vehicles=3", change])
        summary = run_unlogged(scenario)
        worst = max(row.cross_track_error_m_max or 0.0 for row in summary.vehicles)
        found[key, deviation] = worst
    assert found["common_drift", 3.0] < found["common_drift", 0.0] + 0.15
    assert found["drift", 3.0] > 1.0
