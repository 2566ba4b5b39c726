"""Whatever is done by hand, in whatever order: nothing fails, and by schedule it is the same."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import isfinite

from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.definition.schema.change_tables import (
    AnyChange,
    CrashTable,
    FixChangeTable,
    JoinTable,
    LeaveTable,
    SpeedChangeTable,
    StallTable,
)
from scenarios.runs.node.outbox import DueChange
from tests.made.convoys.changed_convoys import ChangedConvoy, changed
from transport.codec import encode
from vehicles.messages import Change, Command, GpsPose, LinkVerdict, LogText, TruePose
from vehicles.schedule import SECOND, nanoseconds

times = st.integers(0, 3900).map(lambda k: k / 1000.0)
some = st.integers(100, 200).map(lambda k: k / 100.0)
names = st.sampled_from(["v1", "v2", "v3"])
followers = st.sampled_from(["v2", "v3"])
fixes = st.sampled_from(["fixed", "float", "single", "none", "auto"])
anything = st.one_of(
    st.builds(StallTable, kind=st.just("stall"), at_s=times, vehicle=names, for_s=some),
    st.builds(CrashTable, kind=st.just("crash"), at_s=times, vehicle=names, for_s=some),
    st.builds(LeaveTable, kind=st.just("leave"), at_s=times, vehicle=followers),
    st.builds(JoinTable, kind=st.just("join"), at_s=times, vehicle=followers),
    st.builds(
        FixChangeTable,
        kind=st.just("gnss"),
        at_s=times,
        vehicle=names,
        fix=fixes,
        for_s=st.one_of(st.none(), some),
    ),
    st.builds(
        SpeedChangeTable,
        kind=st.just("speed"),
        at_s=times,
        speed_mps=st.floats(0.0, 25.0),
        acceleration_mps2=st.floats(0.5, 4.0),
    ),
)
SHORT = ("duration_s=4", 'control.own_state="estimated"')


def by_hand(changes: Sequence[AnyChange], *overrides: str) -> ChangedConvoy:
    """Run the convoy with changes requested by hand before their time."""
    convoy = ChangedConvoy(changed(overrides=(*SHORT, *overrides)))
    for change in changes:
        at = convoy.start_at + nanoseconds(change.at_s)
        whom = [change.vehicle] if hasattr(change, "vehicle") else list(convoy.nodes)
        for name in whom:
            convoy.nodes[name].pending_changes.add(DueChange(at, change, by_hand=True))
    return convoy.run()


@settings(max_examples=8, deadline=None)
@given(st.lists(anything, min_size=1, max_size=6), st.sampled_from(["same", "gap"]))
def test_nothing_fails_whatever_is_done(changes: list[AnyChange], kept: str) -> None:
    run = by_hand(changes, f'speed.followers="{kept}"')
    for name in ("v1", "v2", "v3"):
        truths = run.of(name, TruePose)
        assert len(truths) == 4 * 50
        for pose in truths:
            assert isfinite(pose.east_m + pose.north_m + pose.yaw_rad + pose.speed_mps)
            assert 0.0 <= pose.speed_mps < 40.0
        for before, after in pairwise(run.of(name, Command)):
            span = (after.decided_at_ns - before.decided_at_ns) / SECOND
            assert abs(after.steering_rad - before.steering_rad) <= 1.18 * span + 1e-12
            assert isfinite(after.acceleration_mps2)
        for kind in (GpsPose, TruePose, LinkVerdict, LogText, Change):
            numbers = [one.seq for one in run.of(name, kind)]
            assert numbers == list(range(len(numbers)))
        done = len(run.of(name, Change))
        passed_over = [one for one in run.of(name, LogText) if "has no effect" in one.text]
        mine = [one for one in changes if getattr(one, "vehicle", name) == name]
        assert done + len(passed_over) == len(mine)


@settings(max_examples=5, deadline=None)
@given(anything)
def test_changes_by_hand_are_repeated_by_schedule(change: AnyChange) -> None:
    if isinstance(change, JoinTable):  # by schedule it would not be there before
        return
    hand = by_hand([change])
    (table,) = {one.table for one in hand.sent if isinstance(one, Change)}
    tables = hand.scenario.tables.model_copy(update={"change": (change,)})
    plan = ChangedConvoy(type(hand.scenario)(tables)).run()
    assert {one.table for one in plan.sent if isinstance(one, Change)} == {table}
    requested = [
        replace(one, by_hand=True) if isinstance(one, Change) else one for one in plan.sent
    ]
    assert list(map(encode, requested)) == list(map(encode, hand.sent))  # NaN equals NaN there
