"""What is done to vehicles while they run: each kind by what it may and may not change."""

import json
import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.runs.node.node import Node, VehicleFaultError
from scenarios.runs.node.outbox import NoProbe
from scenarios.runs.node.phases import BRAKING, Down
from scenarios.runs.virtual import steps_in_order
from tests.made.convoys.changed_convoys import ChangedConvoy, changed
from tests.made.examples import examples
from transport.codec import encode
from transport.topics import valid_at
from vehicles.messages import (
    Change,
    Command,
    GpsPose,
    LinkVerdict,
    LogText,
    Message,
    Tracking,
    TruePose,
)
from vehicles.schedule import SECOND

CONTROL_S = 0.02


def driven(*changes: str, rest: str = "", overrides: tuple[str, ...] = ()) -> ChangedConvoy:
    return ChangedConvoy(changed(*changes, rest=rest, overrides=overrides)).run()


@pytest.fixture(scope="module")
def calm() -> ChangedConvoy:
    """Nothing is done to it."""
    return driven()


def sent_between(run: ChangedConvoy, vehicle: str, begin: float, end: float) -> list[GpsPose]:
    return [
        pose
        for pose in run.of(vehicle, GpsPose)
        if begin <= (pose.sent_at_ns - run.start_at) / SECOND < end
    ]


def until(run: ChangedConvoy, at_s: float, *kinds: type[Message]) -> list[bytes]:
    """Messages of all vehicles before an instant, as bytes: NaN equals NaN there."""
    end = run.start_at + round(at_s * SECOND)
    return [encode(one) for one in run.sent if type(one) in kinds and valid_at(one) < end]


def test_later_changes_have_no_earlier_effect(calm: ChangedConvoy) -> None:
    kinds = (TruePose, GpsPose, Command, Tracking, LinkVerdict)
    for change in (
        'kind = "stall"\nvehicle = "v2"\nfor_s = 1.0',
        'kind = "crash"\nvehicle = "v1"\nfor_s = 1.0',
        'kind = "leave"\nvehicle = "v3"',
        'kind = "gnss"\nvehicle = "v1"\nfix = "single"',
        'kind = "speed"\nspeed_mps = 5.0',
    ):
        run = driven(f"at_s = 2.0\n{change}", overrides=("duration_s=3.5",))
        assert until(run, 2.0, *kinds) == until(calm, 2.0, *kinds)
        assert until(run, 3.0, *kinds) != until(calm, 3.0, *kinds), change


def test_a_stall_holds_the_command_and_sends_nothing_and_messages_wait(
    calm: ChangedConvoy,
) -> None:
    run = driven('kind = "stall"\nvehicle = "v2"\nat_s = 1.5\nfor_s = 0.7')
    assert not sent_between(run, "v2", 1.5, 2.2)
    decided = [(one.decided_at_ns - run.start_at) / SECOND for one in run.of("v2", Command)]
    assert not [at for at in decided if 1.5 <= at < 2.2]
    assert len(run.of("v2", TruePose)) == len(calm.of("v2", TruePose))
    received = [one for one in run.of("v2", LinkVerdict) if one.outcome == "delivered"]
    assert [one.pose_seq for one in received] == list(range(len(received)))  # not one is lost
    waited = [
        one
        for one in received
        if one.visible_at_ns - run.start_at in range(1_520_000_000, 2_200_000_000)
    ]
    assert waited
    assert {one.received_at_ns - run.start_at for one in waited} == {2_200_000_000}
    assert not any(one.late for one in received)


def test_a_car_whose_software_is_down_brakes_with_its_wheels_as_they_were() -> None:
    run = driven('kind = "crash"\nvehicle = "v2"\nat_s = 1.0\nfor_s = 3.0')
    truth = run.truths("v2")
    assert not sent_between(run, "v2", 1.0, 4.0)
    first = truth[1.0].speed_mps
    for at, pose in truth.items():
        if 1.0 <= at <= 4.0:
            assert pose.speed_mps == pytest.approx(max(first - BRAKING * (at - 1.0), 0.0), abs=0.05)
        if 2.0 <= at <= 4.0:  # the actuator has settled
            assert pose.steering_rad == pytest.approx(truth[2.0].steering_rad, abs=1e-6)


def test_new_software_remembers_nothing_and_numbers_go_on() -> None:
    run = driven('kind = "crash"\nvehicle = "v2"\nat_s = 1.0\nfor_s = 1.5')
    for kind in (GpsPose, TruePose, LinkVerdict, LogText, Change):
        numbers = [one.seq for one in run.of("v2", kind)]
        assert numbers == list(range(len(numbers))), kind.__name__
    received = [one.sent_at_ns - run.start_at for one in run.of("v2", LinkVerdict)]
    assert not [at for at in received if 1_000_000_000 <= at < 2_500_000_000]
    assert min(at for at in received if at > 1_000_000_000) == 2_500_000_000
    (first, *_) = [
        one for one in run.of("v2", Tracking) if one.decided_at_ns >= run.start_at + 2_500_000_000
    ]
    assert first.mode == "straight"
    behind = [one for one in run.of("v3", Tracking) if one.mode == "composite"]
    assert max(one.decided_at_ns for one in behind) > run.start_at + 3 * SECOND


def test_a_crash_for_good_is_a_fault() -> None:
    with pytest.raises(VehicleFaultError, match="v2: its process has crashed, as requested"):
        driven('kind = "crash"\nvehicle = "v2"\nat_s = 1.003')


def test_a_late_joiner_is_driven_by_a_human_without_messages_until_then(
    calm: ChangedConvoy,
) -> None:
    run = driven('kind = "join"\nvehicle = "v3"\nat_s = 3.0')
    assert not sent_between(run, "v3", 0.0, 3.0)
    assert len(sent_between(run, "v3", 3.0, 6.0)) == 60
    assert not [
        one for one in run.of("v3", Command) if one.decided_at_ns < run.start_at + 3 * SECOND
    ]
    assert min(one.sent_at_ns for one in run.of("v3", LinkVerdict)) == run.start_at + 3 * SECOND
    for at, pose in run.truths("v3").items():  # a human keeps to the same road at the same speed
        other = calm.truths("v3")[at]
        assert math.hypot(pose.east_m - other.east_m, pose.north_m - other.north_m) < 0.7


def test_a_leaver_drives_on_along_the_road(calm: ChangedConvoy) -> None:
    run = driven('kind = "leave"\nvehicle = "v2"\nat_s = 2.0')
    assert all(pose.leaving for pose in sent_between(run, "v2", 2.0, 3.0))
    assert not sent_between(run, "v2", 3.0, 6.0)
    for at, pose in run.truths("v2").items():
        other = calm.truths("v2")[at]
        assert math.hypot(pose.east_m - other.east_m, pose.north_m - other.north_m) < 0.7
    modes = {one.mode for one in run.of("v3", Tracking) if one.decided_at_ns > run.start_at + 4e9}
    assert "composite" not in modes


def test_commands_never_step_by_more_than_the_wheels_turn() -> None:
    """Whoever takes over begins with the command that the car has."""
    run = driven(
        'kind = "stall"\nvehicle = "v2"\nat_s = 2.1\nfor_s = 0.2',
        'kind = "crash"\nvehicle = "v2"\nat_s = 2.61\nfor_s = 1.0',
        'kind = "leave"\nvehicle = "v3"\nat_s = 3.0',
        'kind = "join"\nvehicle = "v3"\nat_s = 3.5',
    )
    for name in ("v1", "v2", "v3"):
        commands = run.of(name, Command)
        for before, after in pairwise(commands):
            span = (after.decided_at_ns - before.decided_at_ns) / SECOND
            assert abs(after.steering_rad - before.steering_rad) <= 1.18 * span + 1e-12


@pytest.mark.parametrize(("fix", "worst"), [("single", 1.0), ("float", 0.1)])
def test_a_forced_fix_holds_until_its_end(fix: str, worst: float, calm: ChangedConvoy) -> None:
    run = driven(f'kind = "gnss"\nvehicle = "v1"\nat_s = 1.003\nfor_s = 2.0\nfix = "{fix}"')
    at = {(one.sent_at_ns - run.start_at) / SECOND: one for one in run.of("v1", GpsPose)}
    assert {one.fix for t, one in at.items() if 1.003 <= t < 3.003} == {fix}
    assert {one.fix for t, one in at.items() if not 1.003 <= t < 3.003} == {"fixed"}
    assert all(one.position_accuracy_m > worst for one in at.values() if one.fix == fix)
    assert len(at) == len(calm.of("v1", GpsPose))


def test_without_a_fix_nothing_is_sent_and_its_own_law_comes_back() -> None:
    run = driven(
        'kind = "gnss"\nvehicle = "v1"\nat_s = 1.0\nfix = "none"',
        'kind = "gnss"\nvehicle = "v1"\nat_s = 2.0\nfix = "auto"',
    )
    assert not sent_between(run, "v1", 1.0, 2.0)
    assert len(sent_between(run, "v1", 2.0, 6.0)) == 80


@pytest.mark.parametrize("followers", ["same", "gap"])
def test_another_set_speed_is_come_to_evenly(followers: str) -> None:
    change = 'kind = "speed"\nat_s = 1.0\nspeed_mps = 10.0\nacceleration_mps2 = 2.0'
    run = driven(change, overrides=(f'speed.followers="{followers}"',))
    for at, pose in run.truths("v1").items():
        planned = min(max(15.0 - 2.0 * (at - 1.0), 10.0), 15.0)
        assert pose.speed_mps == pytest.approx(planned, abs=0.3)
    vehicles = {one.vehicle for one in run.sent if isinstance(one, Change)}
    assert vehicles == ({"v1", "v2", "v3"} if followers == "same" else {"v1"})
    last = run.truths("v3")[5.98]
    assert last.speed_mps == pytest.approx(10.0, abs=0.5)


def test_a_wrong_clock_moves_only_stamps_and_what_is_derived_from_them(
    calm: ChangedConvoy,
) -> None:
    run = driven(rest="[vehicle.v2.clock]\noffset_ms = 250.0\ndrift_ppm = 1000.0")
    for pose, usual in zip(run.of("v2", GpsPose), calm.of("v2", GpsPose), strict=True):
        since = usual.measured_at_ns - run.start_at
        assert pose.measured_at_ns - usual.measured_at_ns == 250_000_000 + round(since / 1000)
        assert pose.sent_at_ns == usual.sent_at_ns
    ages = [one.lead_age_s for one in run.of("v2", Tracking)[10:]]
    usual_ages = [one.lead_age_s for one in calm.of("v2", Tracking)[10:]]
    for k, (age, usual_age) in enumerate(zip(ages, usual_ages, strict=True)):
        assert age - usual_age == pytest.approx(0.25 + 0.001 * CONTROL_S * (k + 10), abs=1e-3)
    # v3 sees the ages of v2 too small by that, and receives the same.
    seen = [one.predecessor_age_s for one in run.of("v3", Tracking)[10:]]
    usual_seen = [one.predecessor_age_s for one in calm.of("v3", Tracking)[10:]]
    for k, (age, usual_age) in enumerate(zip(seen, usual_seen, strict=True)):
        assert age - usual_age == pytest.approx(-0.25 - 0.001 * CONTROL_S * (k + 10), abs=1e-3)
    verdicts = [(one.pose_seq, one.received_at_ns) for one in run.of("v3", LinkVerdict)]
    assert verdicts == [(one.pose_seq, one.received_at_ns) for one in calm.of("v3", LinkVerdict)]
    assert not run.nodes["v3"].inbox.rejected


@pytest.mark.parametrize("offset_ms", [-10_000.0, 10_000.0])
def test_messages_of_a_clock_off_by_ten_seconds_are_received(offset_ms: float) -> None:
    run = driven(rest=f"[vehicle.v1.clock]\noffset_ms = {offset_ms}")
    for name in ("v2", "v3"):
        assert not run.nodes[name].inbox.rejected
        assert run.nodes[name].inbox.delivered > 100


@examples(3, 12)
@given(
    at_s=st.integers(50, 350).map(lambda k: k / 100.0),
    for_s=st.integers(100, 250).map(lambda k: k / 100.0),
    name=st.sampled_from(["v1", "v2", "v3"]),
)
def test_a_restarted_process_continues_from_the_handover(
    at_s: float, for_s: float, name: str
) -> None:
    """What is sent is equal to the bit."""
    scenario = changed(
        f'kind = "crash"\nvehicle = "{name}"\nat_s = {at_s}\nfor_s = {for_s}',
        'kind = "speed"\nat_s = 1.0\nspeed_mps = 12.0',
        'kind = "gnss"\nvehicle = "v2"\nat_s = 5.5\nfix = "float"',
        rest="[gnss]\ndrift = { deviation_m = 0.1, time_constant_s = 30.0 }\n"
        "[links]\nloss_ratio = 0.2\njitter_ms = 10.0",
    )
    kept, restarted = ChangedConvoy(scenario).run(), ChangedConvoy(scenario)
    exchanged = 0
    for tick, step in steps_in_order(restarted.steps()):
        step(tick)
        node = restarted.nodes[name]
        assert isinstance(node, Node)
        handover = node.handover(tick.at)
        if handover is None or exchanged:
            continue
        exchanged += 1
        arrived = node.inbox
        other = restarted.builders[name].node(
            restarted.start_at, restarted.sink(name), NoProbe(), handover
        )
        assert isinstance(other, Node)
        assert isinstance(other.phase, Down)
        assert other.inbox is not arrived
        restarted.set_node(name, other)
    assert exchanged == 1
    assert list(map(encode, restarted.sent)) == list(map(encode, kept.sent))


def test_each_change_is_logged_once_by_the_vehicle_that_carries_it_out() -> None:
    run = driven('kind = "stall"\nvehicle = "v2"\nat_s = 1.003\nfor_s = 0.5')
    (change,) = [one for one in run.sent if isinstance(one, Change)]
    assert (change.vehicle, change.kind, change.by_hand) == ("v2", "stall", False)
    assert change.effective_at_ns - run.start_at == 1_003_000_000
    table = {"kind": "stall", "vehicle": "v2", "at_s": 1.003, "for_s": 0.5}
    assert json.loads(change.table) == table
    lines = [one for one in run.of("v2", LogText) if "stalls" in one.text]
    assert [line.level for line in lines] == ["info"]
    assert lines[0].logged_at_ns - run.start_at == 1_020_000_000  # its first tick from then on


def test_noise_after_a_stall_is_that_without_one(calm: ChangedConvoy) -> None:
    run = driven('kind = "stall"\nvehicle = "v2"\nat_s = 1.5\nfor_s = 0.7')
    truth, other = run.truths("v2"), calm.truths("v2")
    before = {pose.measured_at_ns: pose for pose in calm.of("v2", GpsPose)}
    compared = 0
    for pose in run.of("v2", GpsPose):
        at = round((pose.measured_at_ns - run.start_at) / SECOND, 6)
        if at in truth and pose.measured_at_ns in before:
            noise = pose.speed_mps - truth[at].speed_mps
            usual = before[pose.measured_at_ns].speed_mps - other[at].speed_mps
            assert noise == pytest.approx(usual, abs=1e-9)
            compared += 1
    assert compared > 40


def test_a_leaver_can_join_again() -> None:
    run = driven(
        'kind = "leave"\nvehicle = "v2"\nat_s = 1.0', 'kind = "join"\nvehicle = "v2"\nat_s = 2.0'
    )
    assert all(pose.leaving for pose in sent_between(run, "v2", 1.0, 2.0))
    again = sent_between(run, "v2", 2.0, 6.0)
    assert len(again) == 80
    assert not [pose for pose in again if pose.leaving]
