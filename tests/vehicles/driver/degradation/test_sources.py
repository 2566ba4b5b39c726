"""Status and weight of a source at 20 Hz straight ahead, with lost messages."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.made.transport.received_poses import received
from tests.made.vehicles.exact_drives import GNSS_HZ, START
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.source import SLOW_PROBATION, SLOW_SPEED, Source
from vehicles.driver.degradation.sources import Sources
from vehicles.driver.ego.own_state import Pose
from vehicles.messages import NO_ANNOUNCEMENT, Announcement, Mode, SourceStatus
from vehicles.preview.curve_fit import FitSettings
from vehicles.schedule import SECOND, instant

TICK = SECOND // 50
SPEED, SPACING = 20.0, 15.0
DEGRADE = DegradationSettings()


@dataclass(frozen=True)
class Look:
    seconds: float
    status: SourceStatus
    silence: float
    known: float
    weight: float
    probation: float


def observed(
    comes: Callable[[int], bool],
    seconds: float,
    *,
    latency: int = TICK,
    own_speed: float = SPEED,
    degradation: DegradationSettings = DEGRADE,
) -> Iterator[Look]:
    """States of a source at every control instant; `comes` selects the messages that arrive."""
    source, sent = Source("v1", 1.0 / GNSS_HZ, degradation), 0
    source.usable = True
    for tick in range(round(seconds * 50)):
        now = START + tick * TICK
        while (at := instant(START, sent, GNSS_HZ)) + latency <= now:
            if comes(sent):
                east = SPACING + SPEED * (at - START) / SECOND
                source.receive(received(at, east, 0.0, 0.0, SPEED, seq=sent, received_at=now))
            sent += 1
        pose = Pose(own_speed * tick / 50, 0.0, 0.0, own_speed, 0.0)
        source.update(now, pose, TICK / SECOND, refit=True)
        seen = source.freshness
        yield Look(
            tick / 50,
            seen.status,
            seen.silence,
            seen.known,
            source.weight,
            source.probation.length,
        )


def statuses(looks: list[Look]) -> list[tuple[SourceStatus, float]]:
    changes: list[tuple[SourceStatus, float]] = []
    for look in looks:
        if not changes or look.status != changes[-1][0]:
            changes.append((look.status, look.seconds))
    return changes


def test_a_silent_source_is_late_then_lost_then_on_probation() -> None:
    """Received last at 4.0 s (sent at 3.95 s with 20 ms, next tick), and again from 6.02 s on."""
    looks = list(observed(lambda seq: not 80 <= seq < 120, 9.0))
    assert statuses(looks) == [
        ("unheard", 0.0),
        ("fresh", 0.02),
        ("late", pytest.approx(3.98 + 0.15, abs=0.021)),
        ("lost", pytest.approx(3.98 + 0.5, abs=0.021)),
        ("probation", 6.02),
        ("fresh", pytest.approx(7.02, abs=0.021)),
    ]


def test_thresholds_are_exact_to_the_tick() -> None:
    for look in observed(lambda seq: not 80 <= seq < 120, 6.0):
        if look.status in ("fresh", "late", "lost") and look.seconds < 6.0:
            late, lost = look.silence > 0.15 + 1e-9, look.silence > 0.5 + 1e-9
            assert look.status == ("lost" if lost else "late" if late else "fresh"), look


@pytest.mark.parametrize("latency_ms", [0, 100, 600, 3000])
def test_latency_alone_loses_no_source(latency_ms: int) -> None:
    looks = list(observed(lambda _: True, 9.0, latency=latency_ms * 1_000_000))
    assert [status for status, _ in statuses(looks)][-1] == "fresh"
    assert {look.status for look in looks} <= {"unheard", "fresh"}
    assert {look.weight for look in looks} == {1.0}


def test_relapses_double_the_probation_but_it_always_ends() -> None:
    """Silent for 0.6 s every 3 s up to 30 s: from the third relapse on no probation is served."""
    looks = list(observed(lambda seq: seq >= 600 or seq % 60 < 48, 47.0))
    lengths = sorted({look.probation for look in looks})
    assert lengths == [1.0, 2.0, 4.0, 8.0, 16.0]
    trusted = [at for status, at in statuses(looks) if status == "fresh"]
    assert len(trusted) == 4  # initially, after two relapses, and finally
    assert looks[-1].status == "fresh"


def test_a_source_that_delivers_less_than_before_is_finally_relied_on() -> None:
    looks = list(observed(lambda seq: seq < 200 or (seq >= 240 and seq % 2 == 0), 60.0))
    assert looks[-1].status == "fresh"


patterns = st.lists(st.tuples(st.integers(1, 40), st.integers(1, 60)), min_size=1, max_size=12)


@given(patterns, st.floats(0.0, 30.0))
@settings(max_examples=30)
def test_the_status_does_not_flap_and_the_weight_has_no_steps(
    pattern: list[tuple[int, int]], own_speed: float
) -> None:
    """Alternating runs of received and lost messages."""
    comes = [c for received, lost in pattern for c in [True] * received + [False] * lost]
    seconds = len(comes) / GNSS_HZ
    looks = list(observed(lambda seq: comes[seq % len(comes)], seconds, own_speed=own_speed))
    given_up: list[float] = []
    for before, look in pairwise(looks):
        if look.status == "lost" != before.status:
            assert before.status != "unheard"
            given_up.append(look.seconds)
        if before.status == "probation" and look.status in ("fresh", "late"):
            served = min(look.probation, math.inf if own_speed >= SLOW_SPEED else SLOW_PROBATION)
            assert look.seconds - given_up[-1] >= served - 1e-9
        assert look.status not in ("fresh", "late") or before.status != "lost"
        assert 0.0 <= look.weight <= 1.0
        assert look.weight <= before.weight + 0.02 + 1e-9
        if look.known > 0.0 and before.known > 0.0:
            # It fades with the share of the known path driven meanwhile, and no faster.
            fades = before.weight * own_speed * 0.02 / before.known
            assert look.weight >= before.weight - fades - 1e-9, look


def test_baselines_keep_all_weights() -> None:
    looks = observed(
        lambda seq: not 80 <= seq < 120,
        9.0,
        degradation=DegradationSettings(reaction="extrapolate"),
    )
    assert {look.weight for look in looks} == {1.0}


@given(st.floats(0.02, 0.2), st.floats(0.0, 2.0))
def test_a_first_message_is_awaited_as_long_as_any_other(period: float, delay: float) -> None:
    source = Source("v1", period, DEGRADE, delay)
    after = DEGRADE.lost_after_silence(period)
    for tick in range(200):
        now, waited = START + tick * TICK, tick / 50 - delay
        source.update(now, Pose(0.0, 0.0, 0.0, 0.0, 0.0), TICK / SECOND, refit=False)
        assert source.status == "unheard"
        assert source.freshness.lost_at == pytest.approx(START + (delay + after) * SECOND, abs=2)
        if abs(waited - after) > 1e-6:
            assert source.never_received == (waited > after)
        if abs(waited - 1.5 * period) > 1e-6:
            assert source.is_overdue == (waited > 1.5 * period)


def off_path(offsets: dict[int, float], *, last: int = 160) -> list[int]:
    """Numbers of the messages after which a source that may leave the path has left it.

    It is silent from 80 to 119; `offsets` (m) are those of some messages, the others announce 0.
    """
    source, left = Source("v2", 1.0 / GNSS_HZ, DEGRADE), list[int]()
    source.may_leave_path = True
    for seq in range(last):
        now = instant(START, seq, GNSS_HZ)
        if not 80 <= seq < 120:
            announced = Announcement(mode="lead", path_offset_m=offsets.get(seq, 0.0))
            east = SPEED * (now - START) / SECOND
            source.receive(
                received(now, east, 0.0, 0.0, SPEED, seq=seq, received_at=now, announced=announced)
            )
            if source.has_left_path:
                left.append(seq)
        source.update(now, Pose(0.0, 0.0, 0.0, SPEED, 0.0), 1.0 / GNSS_HZ, refit=True)
    return left


def test_positions_far_beside_the_path_are_not_followed() -> None:
    assert off_path({5: 1.7, 6: 2.3, 7: -80.0, 8: -1.7}) == [6, 7]


def test_after_a_silence_positions_are_followed_once_their_offset_is_known() -> None:
    unknown = dict.fromkeys([0, 1, 40, *range(120, 126)], math.nan)
    assert off_path(unknown) == list(range(120, 126))


def test_a_guess_over_a_long_hole_is_not_used_beside_close_samples_of_the_lead() -> None:
    """The predecessor left the path from 0 to 20 m, where samples of the lead are 7 m apart."""
    lead, ahead = Source("v1", 1.0, DEGRADE), Source("v2", 1.0, DEGRADE)
    pair = Sources([lead, ahead], DEGRADE, lead="v1", predecessor="v2", lateral=["v1", "v2"])
    for seq in range(16):
        at, east = START + seq * SECOND, 7.0 * seq - 35.0
        mode: Mode = "coast" if 0.0 < east < 20.0 else "lead"
        announced = Announcement(mode=mode, path_offset_m=0.0)
        for name, announces in (("v1", NO_ANNOUNCEMENT), ("v2", announced)):
            pair.receive(
                received(at, east, 0.0, 0.0, 7.0, seq=seq, vehicle=name, announced=announces)
            )
    windows = pair.windows(Pose(10.0, 0.0, 0.0, 7.0, 0.0), FitSettings(), runs_out=False)
    assert ahead.trace.holes
    positions = windows["v2"].east.tolist() if "v2" in windows else []
    assert not [east for east in positions if 0.5 < east < 20.5]
    assert [east for east in windows["v1"].east if 0.0 < east < 20.5]
