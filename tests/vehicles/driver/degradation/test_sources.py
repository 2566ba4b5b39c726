"""Status and weight of a source at 20 Hz straight ahead, with lost messages."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.made.transport.received_poses import received
from tests.made.vehicles.exact_drives import GNSS_HZ, START
from vehicles.driver.own_state import Pose
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.source import Reception, Source
from vehicles.messages import Announcement, SourceStatus
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
    lost_after: float


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
        seen = source.state
        yield Look(
            tick / 50,
            seen.status,
            seen.silence,
            seen.known,
            source.weight,
            source.reception.lost_after,
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
        ("fresh", pytest.approx(6.52, abs=0.021)),
    ]


@pytest.mark.parametrize("latency_ms", [0, 100, 600, 3000])
def test_latency_alone_loses_no_source(latency_ms: int) -> None:
    looks = list(observed(lambda _: True, 9.0, latency=latency_ms * 1_000_000))
    assert [status for status, _ in statuses(looks)][-1] == "fresh"
    assert {look.status for look in looks} <= {"unheard", "fresh"}
    assert {look.weight for look in looks} == {1.0}


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
    returned: list[float] = []
    for before, look in pairwise(looks):
        if look.status == "probation" != before.status:
            returned.append(look.seconds)
        if before.status == "probation" and look.status in ("fresh", "late"):
            assert look.seconds - returned[-1] >= DEGRADE.probation - 1e-9
        assert look.status not in ("fresh", "late") or before.status != "lost"
        assert 0.0 <= look.weight <= 1.0
        assert look.weight <= before.weight + 0.04 + 1e-9
        if look.known > 0.0 and before.known > 0.0:
            # It fades with the share of the known path driven meanwhile, and no faster.
            fades = before.weight * own_speed * 0.02 / before.known
            assert look.weight >= before.weight - fades - 1e-9, look


@pytest.mark.parametrize("loss", [0.0, 0.2, 0.4])
@pytest.mark.parametrize("rate_hz", [10.0, 20.0])
def test_a_source_is_lost_after_a_silence_that_its_losses_do_not_explain(
    loss: float, rate_hz: float
) -> None:
    """With independent losses, n missing messages in a row have the probability loss to the n."""
    random, reception = np.random.default_rng(1), Reception(1.0 / rate_hz, DEGRADE)
    for seq in range(round(60.0 * rate_hz)):
        if random.random() >= loss:
            reception.add(at := round(seq / rate_hz * SECOND), at, seq)
    usual = max(0.5, 10.0 / rate_hz)
    expected = math.log(1e-6) / math.log(loss) / rate_hz if loss else 0.0
    longest = max(1.5, usual)
    assert reception.lost_after == pytest.approx(min(max(expected, usual), longest), rel=0.25)
    assert reception.share(0.0) == pytest.approx(1.0 - loss, abs=0.08)


def test_an_overtaken_message_does_not_take_a_source_off_its_path() -> None:
    source, hazard = Source("v1", 0.05, DEGRADE), Announcement(hazard=True)
    source.may_leave_path = True
    on_path = [received(START + seq * SECOND // 20, float(seq), 0.0, seq=seq) for seq in (0, 1, 3)]
    for pose in (*on_path, received(START + SECOND // 10, 2.0, 0.0, seq=2, announced=hazard)):
        source.receive(pose)
    assert not source.has_left_path


def test_bursts_prolong_the_silence_and_a_cut_does_not() -> None:
    def after(missing: set[int]) -> float:
        reception = Reception(0.05, DEGRADE)
        for seq in range(400):
            if seq not in missing:
                reception.add(at := seq * SECOND // 20, at, seq)
        return reception.lost_after

    bursts = {first + k for first in range(20, 400, 40) for k in range(6)}
    assert after(bursts) > 1.4
    assert after(set(range(100, 140))) == after(set()) == 0.5
