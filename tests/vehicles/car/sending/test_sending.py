"""Sending rules: rates, intervals, cooperative awareness messages, congestion control."""

from collections import Counter
from itertools import islice, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.car.gnss import Fix
from vehicles.car.sending_rules import (
    BusyRatioEntry,
    CamTrigger,
    CongestionControl,
    EveryFix,
    InstantTrigger,
    MeasuredIntervals,
    RateEntry,
    RateProfile,
    ReactiveControl,
    Sender,
    SendingContext,
    SendingTrigger,
    cam_interval,
)
from vehicles.schedule import MILLISECOND, SECOND, Cadence, instants

START = 1_700_000_000_000_000_000
END = START + 100 * SECOND
CONTEXT = SendingContext(START, lambda _: np.random.default_rng(1))


def profile_of(entries: list[tuple[float, float]]) -> RateProfile:
    return RateProfile(profile=tuple(RateEntry(at, rate) for at, rate in entries))


def congested(ratio: float, period: int = 10 * MILLISECOND) -> CongestionControl:
    return CongestionControl((BusyRatioEntry(0.0, ratio),), period)


def sent(
    rule: SendingTrigger | None,
    seconds: float,
    *,
    speed: float = 20.0,
    gnss_hz: float = 100.0,
    ticks_hz: float = 200.0,
    control: ReactiveControl | None = None,
    yaw_rate: float = 0.0,
    acceleration: float = 0.0,
) -> list[tuple[float, float]]:
    """Times of sending and of measuring of each message, both in ms after the start."""
    sender, gnss = Sender(rule, control), Cadence(START, gnss_hz)
    result = []
    for now in instants(START, START + round(seconds * SECOND), ticks_hz):
        fix, at = None, (now - START) / SECOND
        if (seq := gnss.index(now)) is not None:
            faster = speed + acceleration * at
            fix = Fix(seq, now, speed * at, 0.0, yaw_rate * at, faster, yaw_rate)
        if (fix_sent := sender.send(now, fix)) is not None:
            result.append(((now - START) / 1e6, (fix_sent.measured_at - START) / 1e6))
    return result


def gaps(result: list[tuple[float, float]]) -> list[float]:
    return [later - earlier for (earlier, _), (later, _) in pairwise(result)]


def test_a_fixed_rate_sends_the_newest_fix() -> None:
    rule = InstantTrigger(Cadence(START + 30 * MILLISECOND, 8.0).until(END))
    assert sent(rule, 0.6, gnss_hz=20.0) == [
        (30, 0),
        (155, 150),
        (280, 250),
        (405, 400),
        (530, 500),
    ]


@given(
    points=st.lists(
        st.tuples(st.integers(1, 50), st.sampled_from([0.0, 0.5, 1.0, 7.0, 12.5, 30.0])),
        min_size=1, max_size=5,
    )
)  # fmt: skip
def test_a_changing_rate_is_integrated(points: list[tuple[int, float]]) -> None:
    """At the n-th instant the integral of the rate is n."""
    at, profile = 0.0, []
    for tenths, rate in points:
        profile.append((at, rate))
        at += tenths / 10.0
    each = profile_of(profile).instants(CONTEXT, START + 1000 * SECOND)
    result = [(at - START) / SECOND for at in islice(each, 60)]

    def integral(until: float) -> float:
        ends = [*(begin for begin, _ in profile[1:]), float("inf")]
        pieces = zip(profile, ends, strict=True)
        return sum(rate * max(min(end, until) - begin, 0.0) for (begin, rate), end in pieces)

    assert [integral(at) for at in result] == pytest.approx(list(range(len(result))), abs=1e-6)
    if profile[-1][1] > 0.0:
        assert len(result) == 60


# ---- EN 302 637-2


@pytest.mark.parametrize(
    ("speed", "check_ms", "interval"),
    [
        *((30.0, 20, 140), (30.0, 50, 150), (30.0, 100, 200)),
        *((19.99, 10, 210), (19.99, 50, 250), (19.99, 100, 300)),
        *((9.99, 10, 410), (9.99, 50, 450), (9.99, 100, 500)),
        *((60.0, 20, 100), (2.0, 50, 1000)),
    ],
)
def test_awareness_intervals_at_constant_speed(
    speed: float, check_ms: int, interval: float
) -> None:
    """At the first check after more than 4 m, within 0.1 to 1 s."""
    rule = CamTrigger(Cadence(START, 1000.0 / check_ms))
    result = gaps(sent(rule, 8.0, speed=speed))
    assert set(result[3:]) == {interval}
    assert cam_interval(speed, check_ms / 1000.0) == pytest.approx(interval / 1000.0)


def test_a_standing_car_sends_each_second() -> None:
    rule = CamTrigger(Cadence(START, 10.0))
    assert gaps(sent(rule, 5.0, speed=0.0)) == [1000.0] * 4


def test_turning_and_braking_trigger_messages() -> None:
    """0.5 rad/s exceeds 4 deg after 140 ms, 2 m/s² exceeds 0.5 m/s after 250 ms."""
    turning = CamTrigger(Cadence(START, 50.0))
    assert set(gaps(sent(turning, 4.0, speed=1.0, yaw_rate=0.5))) == {140.0}
    braking = CamTrigger(Cadence(START, 50.0))
    assert set(gaps(sent(braking, 4.0, speed=1.0, acceleration=2.0))) == {260.0}


# ---- TS 102 687


def test_congestion_control_has_the_intervals_of_the_table() -> None:
    spans = {0.0: 100, 0.29: 100, 0.3: 200, 0.4: 400, 0.5: 500, 0.59: 500, 0.6: 1000, 1.0: 1000}
    assert {ratio: congested(ratio).longest_interval / MILLISECOND for ratio in spans} == spans


@pytest.mark.parametrize(("ratio", "least"), [(0.0, 100), (0.35, 200), (0.55, 500), (0.7, 1000)])
@pytest.mark.parametrize("kind", ["every_fix", "fixed", "cam", "drawn", "profile"])
def test_no_interval_is_shorter_than_congestion_control_allows(
    kind: str, ratio: float, least: int
) -> None:
    cadence = Cadence(START, 25.0)
    drawn = MeasuredIntervals(intervals=(60 * MILLISECOND,), shares=(1.0,), jitter=0)
    rules: dict[str, SendingTrigger] = {
        "every_fix": EveryFix(),
        "fixed": InstantTrigger(cadence.until(END)),
        "cam": CamTrigger(cadence),
        "drawn": drawn.begin(CONTEXT),
        "profile": profile_of([(0.0, 25.0)]).begin(CONTEXT),
    }
    control = ReactiveControl(congested(ratio), START)
    result = sent(rules[kind], 10.0, speed=40.0, gnss_hz=25.0, control=control)
    later = [gap for gap, (when, _) in zip(gaps(result), result, strict=False) if when > 100.0]
    assert min(later) >= least
    # Rules with a period of 40 ms send at the first allowed instant.
    assert max(later) <= least + 40.0 or kind == "cam"


# ---- Random intervals


@pytest.mark.parametrize(
    ("table", "mean_ms"),
    [
        (MeasuredIntervals(table="cam_vw_highway"), 335),
        (MeasuredIntervals(table="cam_renault_highway"), 441),
    ],
)
@pytest.mark.campaign(20_000, 200_000)
def test_random_intervals_have_the_measured_shares(
    table: MeasuredIntervals, mean_ms: float, campaign: int
) -> None:
    _, shares = table.distribution
    assert sum(shares) == pytest.approx(1.0, abs=0.0011)
    random = np.random.default_rng(1)
    drawn = np.array([table.draw(random) for _ in range(campaign)]) / MILLISECOND
    counted = Counter(np.round(drawn / 100.0).astype(int).tolist())
    for place, share in enumerate(shares, 1):
        expected = share / sum(shares)
        spread = (expected * (1.0 - expected) / campaign) ** 0.5
        assert counted[place] / campaign == pytest.approx(expected, abs=5.0 * spread)
    assert np.mean(drawn) == pytest.approx(mean_ms, abs=5.0 * np.std(drawn) / campaign**0.5 + 1.0)
    off = drawn - 100.0 * np.round(drawn / 100.0)
    assert np.std(off) == pytest.approx(3.0, rel=0.03)  # the cutoff removes 1.3 %
    assert np.max(np.abs(off)) <= 9.0
    assert min(drawn) * MILLISECOND >= table.shortest


def test_random_intervals_keep_their_mean_with_rare_ticks() -> None:
    """A due message waits for the next tick, which does not extend the following interval."""
    intervals = (130 * MILLISECOND, 170 * MILLISECOND)
    rule = MeasuredIntervals(intervals=intervals, shares=(1.0, 1.0)).begin(CONTEXT)
    result = sent(rule, 300.0, gnss_hz=50.0, ticks_hz=50.0)
    assert len(result) == pytest.approx(2000, abs=5 * 2000**0.5 * 20 / 150)
    assert all(when % 20 == 0 for when, _ in result)


@given(seed=st.integers(0, 50), jitter=st.integers(0, 3))
def test_sequence_numbers_never_exceed_the_shortest_interval(seed: int, jitter: int) -> None:
    """The gate of receivers relies on this."""
    rule = MeasuredIntervals(
        intervals=(50 * MILLISECOND,), shares=(1.0,), jitter=jitter * MILLISECOND
    )
    trigger = rule.begin(SendingContext(START, lambda _: np.random.default_rng(seed)))
    for seq, (when, _) in enumerate(sent(trigger, 2.0)):
        assert seq * rule.shortest <= when * MILLISECOND
