"""Errors of positions: common and own, by state, rounding, latency, reported accuracy."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.made.vehicles.receivers import SILENT, USUAL, receiver, started
from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.gnss_error_terms import (
    Bias,
    CommonDrift,
    Drift,
    FixOutageWindow,
    ReceiverState,
    ScheduledStates,
    StateEntry,
)
from vehicles.car.gnss_settings import GnssSettings, StateErrors
from vehicles.schedule import MILLISECOND, SECOND, instants

START = 1_700_000_000_000_000_000
BODY = Body(120.0, -45.0, 2.5, 20.0, 0.1, 0.05, 0.01, 0.0, 300.0)
QUIET = StateErrors(0.0)


def model(fixed: StateErrors = QUIET, floating: StateErrors = QUIET) -> GnssSettings:
    return replace(
        SILENT,
        position_noise=fixed.position_noise,
        drift=fixed.drift,
        entry_jump=fixed.entry_jump,
        accuracy=fixed.accuracy,
        while_float=floating,
        while_single=QUIET,
    )


def scheduled(*entries: tuple[float, ReceiverState]) -> ScheduledStates:
    return ScheduledStates(tuple(StateEntry(at, state) for at, state in entries))


def fixes(made: GnssSettings, seconds: float, place: int = 1, seed: int = 1) -> list[Fix]:
    gnss = receiver(made, START, seed, place)
    end = START + round(seconds * SECOND)
    measured = (gnss.measure(BODY, now) for now in instants(START, end, made.rate))
    return [fix for fix in measured if fix is not None]


def off(fix: Fix) -> tuple[float, float]:
    return fix.east - BODY.east, fix.north - BODY.north


def test_common_drift_cancels_between_vehicles() -> None:
    """Bit-identical at equal instants, also for receivers of different rates."""
    common = replace(model(), common_drift=CommonDrift(3.0, 50.0))
    here = {fix.measured_at: off(fix) for fix in fixes(common, 60.0, 1)}
    there = {fix.measured_at: off(fix) for fix in fixes(common, 60.0, 2)}
    rare = {fix.measured_at: off(fix) for fix in fixes(replace(common, rate=4.0), 30.0, 3)}
    assert here == there
    assert rare.items() <= here.items()
    assert max(map(math.hypot, *zip(*here.values(), strict=True))) > 1.0


def test_own_errors_are_independent_of_common_drift() -> None:
    own = model(StateErrors(0.0, Drift(0.2, 20.0)))
    both = replace(own, common_drift=CommonDrift(3.0, 50.0))
    apart = [
        np.subtract(off(first), off(second))
        for first, second in zip(fixes(own, 20.0, 1), fixes(own, 20.0, 2), strict=True)
    ]
    with_common = [
        np.subtract(off(first), off(second))
        for first, second in zip(fixes(both, 20.0, 1), fixes(both, 20.0, 2), strict=True)
    ]
    assert np.max(np.abs(np.subtract(apart, with_common))) < 1e-9
    assert np.max(np.abs(apart)) > 0.05


def test_white_noise_is_that_of_a_plain_receiver() -> None:
    """The random numbers are the same, so scenarios differ by the drift only."""
    plain = receiver(USUAL, START)
    result = fixes(replace(USUAL, drift=Drift(0.0)), 2.0)
    for k, fix in enumerate(result):
        before = plain.measure(BODY, START + k * 50 * MILLISECOND)
        assert before is not None
        assert off(fix) == pytest.approx(off(before), abs=1e-12)
        assert replace(fix, east=0.0, north=0.0) == replace(before, east=0.0, north=0.0)


def test_a_fix_is_available_after_its_latency() -> None:
    late = replace(model(), latency=70 * MILLISECOND)
    gnss = receiver(late, START)
    known = {}
    for step in range(0, 400, 10):
        fix = gnss.measure(BODY, START + step * MILLISECOND)
        if fix is not None:
            known[step] = (fix.measured_at - START) // MILLISECOND
    assert known == {70: 0, 120: 50, 170: 100, 220: 150, 270: 200, 320: 250, 370: 300}


def test_entry_jumps_are_bounded_and_decay() -> None:
    """When float is entered, also after an outage, the drift starts within 0.5 m."""
    floating = StateErrors(0.0, Drift(2.0, 10.0), entry_jump=0.5)
    entries: list[tuple[float, ReceiverState]] = []
    for k in range(60):
        entries += [(20.0 * k + 5.0, "float"), (20.0 * k + 18.0, "fixed")]
    tunnels = tuple(FixOutageWindow(s * SECOND, (s + 1) * SECOND) for s in range(10, 1200, 20))
    made = replace(model(floating=floating), fix_states=scheduled(*entries), outages=tunnels)
    result = fixes(replace(made, rate=4.0), 1200.0)
    jumps, later = [], []
    for before, fix in pairwise(result):
        if fix.state != "float":
            assert off(fix) == (0.0, 0.0)
        elif before.state != "float" or fix.measured_at - before.measured_at > SECOND:
            jumps.append(math.hypot(*off(fix)))
        else:
            later.append(math.hypot(*off(fix)))
    assert len(jumps) == 120
    assert max(jumps) <= 0.5 + 1e-12
    assert max(jumps) > 0.4
    assert max(later) > 2.0
    start = started(START)
    assert not any(t.covers(BODY, fix.measured_at, start) for fix in result for t in tunnels)


def test_the_reported_accuracy_is_a_share_of_the_deviation() -> None:
    honest = StateErrors(0.3, Drift(0.4, 10.0))
    lying = replace(honest, accuracy=0.05)
    made = replace(model(honest, lying), fix_states=scheduled((1.0, "float")))
    result = fixes(made, 2.0)
    assert {(fix.state, round(fix.accuracy, 12)) for fix in result} == {
        ("fixed", 0.5),
        ("float", 0.025),
    }
    whole = replace(made, common_drift=CommonDrift(1.2, 10.0))
    assert whole.deviation("fixed") == pytest.approx(1.3)
    assert whole.deviation("fixed", shared=False) == pytest.approx(0.5)


@pytest.mark.campaign(150, 2000)
def test_errors_have_the_stated_deviation(campaign: int) -> None:
    made = replace(model(StateErrors(0.3, Drift(0.4, 10.0))), bias=Bias(0.5), quantisation=1.0)
    each = [off(fixes(made, 0.04, place, seed=place)[0]) for place in range(campaign)]
    size = 2 * campaign
    assert np.std(each) == pytest.approx(made.deviation("fixed"), rel=5.0 / math.sqrt(2.0 * size))


def test_a_forced_state_ends_on_request() -> None:
    gnss = receiver(SILENT, START)
    gnss.force("none", START)
    assert gnss.measure(BODY, START) is None
    gnss.force(None, START)
    assert gnss.measure(BODY, START + 50 * MILLISECOND) is not None


def test_a_bias_is_constant_and_partly_random() -> None:
    given = replace(model(), bias=Bias(0.0, 1.0, -2.0))
    assert {off(fix) for fix in fixes(given, 3.0)} == {(1.0, -2.0)}
    drawn = replace(model(), bias=Bias(0.5))
    each = [off(fixes(drawn, 0.1, place)[0]) for place in range(400)]
    assert np.std(each) == pytest.approx(0.5, rel=5 / math.sqrt(2 * 800))
    assert abs(np.mean(each)) < 5 * 0.5 / math.sqrt(800)
