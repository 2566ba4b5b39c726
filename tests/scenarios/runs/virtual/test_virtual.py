"""Whole runs in virtual time: the same again, another seed, and what links do to them."""

import math
import re
from collections import Counter
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from scenarios.results.links import LinkSummary
from scenarios.results.log_summary import summary_of
from scenarios.results.summary import RunSummary
from scenarios.runs.live import LiveRun
from scenarios.runs.observer import OnMessage, Watcher
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from vehicles.messages import (
    CompositeTrajectory,
    GpsPose,
    Health,
    LinkVerdict,
    Message,
    RunStart,
    Tracking,
    TruePose,
)
from vehicles.schedule import SECOND

MS = SECOND // 1000
SHORT = ("duration_s=3",)


@dataclass(frozen=True)
class Ran:
    """A run's log, what is in it, and its summary."""

    scenario: Scenario
    log: bytes
    attached: dict[str, bytes]
    recorded: list[tuple[int, Message]]
    summary: RunSummary

    def of(self, vehicle: str, kind: type[Message]) -> list[Any]:
        return [m for _, m in self.recorded if m.vehicle == vehicle and type(m) is kind]

    def verdicts(self, sender: str, receiver: str) -> list[LinkVerdict]:
        return [m for m in self.of(receiver, LinkVerdict) if m.sender == sender]

    def modes(self, vehicle: str) -> set[str]:
        return {message.mode for message in self.of(vehicle, Tracking)}

    def link(self, sender: str, receiver: str) -> LinkSummary:
        rows = self.summary.links
        return next(row for row in rows if (row.sender, row.receiver) == (sender, receiver))

    def true_path(self, vehicle: str) -> list[tuple[float, float, float]]:
        return [(p.east_m, p.north_m, p.yaw_rad) for p in self.of(vehicle, TruePose)]


def run(scenario: Scenario, *watchers: Watcher) -> Ran:
    with TemporaryDirectory() as folder:
        summary = run_virtual(scenario, Path(folder), Stop(), watchers=watchers)
        log = Path(folder) / "run.mcap"
        reader = LogReader(log)
        recorded = [(at, message) for at, _, message in reader.messages()]
        return Ran(scenario, log.read_bytes(), reader.attachments(), recorded, summary)


@cache
def ran(*overrides: str, name: str = "lane_change", seed: int | None = None) -> Ran:
    return run(load_scenario(name, [*SHORT, *overrides], seed))


# ---- Determinism


def test_two_runs_of_a_scenario_are_equal_byte_for_byte_whatever_watches_them() -> None:
    shown: list[float] = []

    class Watches:
        def update(self, live: LiveRun) -> None:
            shown.append(live.seconds)

    again = run(load_scenario("lane_change", SHORT), Watches())
    assert shown
    assert again.log == ran().log
    assert again.summary == ran().summary


def test_the_start_is_that_of_the_scenario() -> None:
    start = ran().recorded[0][1]
    assert isinstance(start, RunStart)
    assert start.start_at_ns == ran().scenario.start_at_ns
    later = ran("start_at=2027-03-04T05:06:07Z")
    start = later.recorded[0][1]
    assert isinstance(start, RunStart)
    assert start.start_at_ns == 1_804_136_767 * SECOND
    assert later.true_path("v3") == ran().true_path("v3")


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("lane_change", ("duration_s=3",)),
        ("lossy_lane_change", ("duration_s=1",)),
        ("church_lot", ("duration_s=1",)),
        ("highway", ("duration_s=1",)),
    ],
)
def test_a_log_s_own_scenario_gives_the_same_run_again(
    name: str, overrides: tuple[str, ...]
) -> None:
    first = ran(*overrides, name=name)
    again = run(scenario_from_text(first.attached["scenario.toml"].decode()))
    for vehicle in first.scenario.vehicle_names:
        assert again.true_path(vehicle) == first.true_path(vehicle)
    assert again.log == first.log


# ---- What is in the log


def test_every_vehicle_measures_at_its_rate_without_a_gap() -> None:
    for name in ran().scenario.vehicle_names:
        poses = ran().of(name, GpsPose)
        assert [pose.seq for pose in poses] == list(range(3 * 20))
        start = ran().scenario.start_at_ns
        assert [pose.measured_at_ns - start for pose in poses] == [50 * MS * k for k in range(60)]


def test_the_summary_counts_what_is_in_the_log() -> None:
    summary = ran().summary
    assert (summary.outcome, summary.reason) == ("completed", "")
    assert (summary.identity.scenario, summary.identity.clock) == ("lane_change", "virtual")
    assert (summary.duration_s, summary.ran_s) == (3.0, 3.0)
    assert summary.recorder_rejected_messages == {}
    for row in summary.vehicles:
        assert (row.poses, row.missing_poses) == (60, 0)
        assert sum(row.ticks_by_mode.values()) == 150
        assert row.ticks == 180  # the union of 50 and 20 Hz
        assert (row.late_ticks, row.rejected_messages, row.memory_bytes_max) == (0, 0, 0)
        assert row.finished
        assert row.distance_m == pytest.approx(90.0, abs=1.0)
        modes = Counter(message.mode for message in ran().of(row.name, Tracking))
        assert row.ticks_by_mode == modes
    for link in summary.links:
        assert (link.sent, link.late, link.dropped) == (60, 0, {})
        verdicts = ran().verdicts(link.sender, link.receiver)
        assert link.delivered == len(verdicts)
        # Messages sent at the very end are not received.
        assert link.delivered == sum(50 * k + 20 <= 2990 for k in range(60))
        assert link.latency_ms_mean == pytest.approx(20.0)


def test_a_run_that_is_stopped_has_a_whole_log(tmp_path: Path) -> None:
    stop, scenario = Stop(), load_scenario("lane_change", SHORT)

    def after_a_second(at: int, _message: Message) -> None:
        if at >= scenario.start_at_ns + SECOND:
            stop.request("stopped by SIGINT", 130)

    summary = run_virtual(scenario, tmp_path, stop, observers=[OnMessage(after_a_second)])
    assert (summary.outcome, summary.reason) == ("failed", "stopped by SIGINT")
    assert summary.ran_s == pytest.approx(1.0, abs=0.02)
    reader = LogReader(tmp_path / "run.mcap")
    assert not reader.truncated
    last = [message for _, _, message in reader.messages()]
    assert sum(isinstance(message, Health) and message.final for message in last) == 5
    assert max(len(list(reader.messages(["gps"], [name]))) for name in reader.vehicles) == 21


# ---- Links


def test_a_link_that_loses_everything_leaves_the_other_source() -> None:
    silent = ran('link=[{sender="v1", receiver="v3", loss_ratio=1.0}]')
    assert silent.link("v1", "v3").delivered == 0
    assert silent.link("v1", "v3").loss_ratio == 1.0
    assert {verdict.reason for verdict in silent.verdicts("v1", "v3")} == {"loss"}
    assert silent.modes("v3") == {"straight", "predecessor"}
    assert silent.modes("v4") == {"straight", "composite"}
    assert silent.link("v1", "v4").delivered == ran().link("v1", "v4").delivered
    without = ran('link=[{sender="v2", receiver="v3", loss_ratio=1.0}]')
    assert without.modes("v3") == {"straight", "lead"}
    why = [message.reason for message in without.of("v3", Tracking) if message.mode == "lead"]
    assert re.fullmatch(r"v1 received, .* 0\.\d\d s old, .* m ahead; v2 not received yet", why[0])
    alone = "v2 not received yet; alone: predecessor not received yet"
    assert set(why[1:]) == {"v2 not received yet", alone}


@pytest.mark.parametrize("latency_ms", [0, 20, 50, 123])
def test_latency_is_from_measurement_to_the_next_tick(latency_ms: int) -> None:
    late = ran(f"links.latency_ms={latency_ms}", "convoy.vehicles=2")
    verdicts = late.verdicts("v1", "v2")
    assert len(verdicts) >= 57
    for verdict in verdicts:
        assert verdict.visible_at_ns - verdict.measured_at_ns == latency_ms * MS
        assert not verdict.late
        wait = (verdict.received_at_ns - verdict.visible_at_ns) / MS
        assert 0 <= wait < 20
    # The first was measured at the start; control ticks come every 20 ms, GNSS ticks every 50.
    first = min(k for k in (*range(0, 1000, 20), *range(0, 1000, 50)) if k >= latency_ms)
    start = late.scenario.start_at_ns
    assert (verdicts[0].received_at_ns - start) / MS == first


def test_jitter_adds_to_latency_up_to_its_span() -> None:
    verdicts = ran("links.jitter_ms=80").verdicts("v1", "v2")
    delays = [(verdict.visible_at_ns - verdict.measured_at_ns) / MS for verdict in verdicts]
    assert 20 <= min(delays) < 35
    assert 85 < max(delays) <= 100


def test_about_the_requested_share_is_lost() -> None:
    lossy = ran("links.loss_ratio=0.4")
    rows = lossy.summary.links
    judged = sum(row.judged for row in rows)
    lost = sum(row.dropped.get("loss", 0) for row in rows)
    deviation = math.sqrt(judged * 0.4 * 0.6)
    assert abs(lost - 0.4 * judged) < 4 * deviation
    patterns = {tuple(verdict.outcome for verdict in lossy.verdicts("v1", r)) for r in ("v2", "v3")}
    assert len(patterns) == 2  # every link loses messages of its own


def test_a_link_s_rate_lets_every_second_pose_through() -> None:
    slow = ran('link=[{sender="v1", receiver="v2", rate_hz=10.0}]')
    by_number = {verdict.pose_seq: verdict for verdict in slow.verdicts("v1", "v2")}
    assert [by_number[k].outcome for k in range(10)] == ["delivered", "dropped"] * 5
    assert {verdict.reason for verdict in by_number.values()} == {"", "rate"}
    assert slow.link("v1", "v2").loss_ratio == 0.0


def test_a_lead_that_starts_askew_does_not_put_its_followers_off_the_path(tmp_path: Path) -> None:
    askew = ran("vehicle.v1.heading_offset_deg=3")
    for row in askew.summary.vehicles[1:]:
        assert row.cross_track_error_m_max is not None
        assert row.cross_track_error_m_max < 0.3
    # Without its summary, a log gives the same from messages and scenario.
    log = tmp_path / "run.mcap"
    with LogWriter(log) as writer:
        writer.attach(ATTACHED_AS, "application/toml", askew.attached[ATTACHED_AS])
        for at, message in askew.recorded:
            writer.write(at, message)
    assert summary_of(log).vehicles == askew.summary.vehicles


def test_alpha_is_the_weight_of_the_predecessor() -> None:
    """Without weight the predecessor's positions do not matter."""
    beside = "vehicle.v2.lateral_offset_m=0.5"
    for alpha, matters in ((0, False), (1, True)):
        weight = f"vehicle.v3.control.alpha_ratio={alpha}"
        straight, aside = ran(weight), ran(weight, beside)
        assert aside.true_path("v2") != straight.true_path("v2")
        assert (aside.true_path("v3") != straight.true_path("v3")) == matters


def test_another_vehicle_changes_none_ahead_of_it() -> None:
    fewer = ran("convoy.vehicles=3")
    for name in ("v1", "v2", "v3"):
        assert fewer.true_path(name) == ran().true_path(name)


def test_another_seed_is_another_run() -> None:
    other = ran(seed=2)
    assert other.log != ran().log
    assert other.true_path("v2") != ran().true_path("v2")
    assert other.summary.identity.seed == 2


def test_every_vehicle_decides_and_moves_at_the_control_rate() -> None:
    for name in ran().scenario.vehicle_names:
        poses = ran().of(name, TruePose)
        assert [pose.seq for pose in poses] == list(range(3 * 50))
        start = ran().scenario.start_at_ns
        assert [pose.true_at_ns - start for pose in poses] == [20 * MS * k for k in range(150)]
        for before, pose in pairwise(poses):
            distance = math.hypot(pose.east_m - before.east_m, pose.north_m - before.north_m)
            assert distance == pytest.approx(0.02 * 30.0, rel=0.02)
        assert len(ran().of(name, Tracking)) == 150


def test_messages_are_recorded_in_order_at_the_tick_that_sends_them() -> None:
    instants = [at for at, _ in ran().recorded]
    assert instants == sorted(instants)
    for at, message in ran().recorded:
        if isinstance(message, GpsPose):
            assert at == message.measured_at_ns
        elif isinstance(message, Tracking):
            assert at == message.decided_at_ns


def test_vehicles_without_messages_drive_straight_and_stop() -> None:
    silent = ran("links.loss_ratio=1")
    for name in ("v2", "v3", "v4"):
        assert silent.modes(name) == {"straight", "stop"}
        for pose in silent.of(name, TruePose):
            assert abs(pose.steering_rad) < 0.01
    assert silent.true_path("v1") == ran().true_path("v1")


def test_more_latency_lets_a_follower_know_less() -> None:
    ages = [
        max(message.lead_age_s for message in ran(latency).of("v4", Tracking)[50:])
        for latency in ("links.latency_ms=20", "links.latency_ms=120", "links.latency_ms=220")
    ]
    assert ages[1] == pytest.approx(ages[0] + 0.1, abs=0.011)
    assert ages[2] == pytest.approx(ages[0] + 0.2, abs=0.011)


def test_a_sender_with_its_own_gnss_rate_is_received_at_that_rate() -> None:
    quick = ran("vehicle.v1.gnss.rate_hz=40")
    assert len(quick.of("v1", GpsPose)) == 120
    for receiver in ("v2", "v3", "v4"):
        assert quick.link("v1", receiver).delivered >= 118
    assert [row.rejected_messages for row in quick.summary.vehicles] == [0] * 4


def test_a_trajectory_reaches_as_far_as_the_preview() -> None:
    reach = {}
    for preview_s in (0.4, 0.8):
        trajectories = ran(f"control.preview_s={preview_s}").of("v4", CompositeTrajectory)[20:]
        lengths = [sum(trajectory.piece_length_m) for trajectory in trajectories]
        assert min(lengths) > preview_s * 30.0  # there is some behind the ego, too
        reach[preview_s] = sum(lengths) / len(lengths)
    assert reach[0.8] - reach[0.4] == pytest.approx(0.4 * 30.0, abs=1.5)
