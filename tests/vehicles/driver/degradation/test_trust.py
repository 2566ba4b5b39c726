"""Use and refusal of received poses, and the log lines about refusals."""

import math
from collections.abc import Iterable

import pytest

from tests.made.channels.false_content import frozen
from tests.made.transport.received_poses import received
from tests.made.vehicles.exact_drives import START
from tests.made.vehicles.measured_drives import constant_motion, falsify, measured_fixes
from transport.links.laws.false_content import FalseInterval
from vehicles.driver.degradation.innovation_gate import InnovationGate
from vehicles.driver.degradation.trust import Trust
from vehicles.schedule import MILLISECOND, SECOND, nanoseconds

BEGIN, END = 4.0, 7.0
SPELL = FalseInterval(START + nanoseconds(BEGIN), START + nanoseconds(END))
PERIOD = 50 * MILLISECOND


def test_refusals_and_their_end_are_logged_once() -> None:
    remarks: list[str] = []
    trust = Trust("v1", InnovationGate(), remarks)
    fixes = measured_fixes(constant_motion(15.0), seconds=12.0, speed=15.0)
    for pose in falsify(fixes, frozen(SPELL)):
        is_false = BEGIN <= (pose.measured_at - START) / SECOND < END
        assert trust.judge(pose) == ("frozen" if is_false else "")
    assert remarks == ["v1 distrusted: frozen", "v1 trusted again; 60 poses refused"]


def test_without_a_gate_only_jumps_are_refused() -> None:
    remarks: list[str] = []
    trust = Trust("v1", None, remarks)
    for pose in falsify(measured_fixes(constant_motion(15.0), seconds=7.0), frozen(SPELL)):
        assert trust.judge(pose) == ""  # frozen ones too
    assert remarks == []


def reasons(places: Iterable[tuple[int, float, float]], speed: float = 10.0) -> list[str]:
    """Verdicts on poses by number, east and north (m), of a source that drives east."""
    trust = Trust("v1")
    return [trust.judge(received(k * PERIOD, e, n, 0.0, speed)) for k, e, n in places]


def test_single_jumps_are_refused() -> None:
    drive = [(k, 0.5 * k, 0.0) for k in range(45)]
    false = {40: (20.0, 80.0), 42: (20.0, -80.0), 43: (20.0, 80.0)}
    verdicts = reasons((k, *false.get(k, (east, north))) for k, east, north in drive)
    assert [k for k, reason in enumerate(verdicts) if reason] == sorted(false)
    assert {verdicts[k] for k in false} == {"jumping"}


def test_three_consistent_poses_are_a_new_position() -> None:
    verdicts = reasons((k, 0.5 * k, 0.0 if k < 40 else 30.0) for k in range(60))
    assert [k for k, reason in enumerate(verdicts) if reason] == [40, 41]


def test_after_a_silence_any_reachable_position_is_used() -> None:
    assert reasons([(0, 0.0, 0.0), (200, 100.0, 0.0)]) == ["", ""]  # 10 s at 10 m/s later


def test_late_poses_pass() -> None:
    assert reasons([(5, 2.5, 0.0), (4, 400.0, 0.0), (6, 3.0, 0.0)]) == ["", "", ""]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite_are_refused(value: float) -> None:
    for place in range(4):
        values = [1.0, 2.0, 3.0, 4.0]
        values[place] = value
        trust = Trust("v1")
        trust.judge(received(START, 0.0, 0.0))
        east, north, yaw, speed = values
        assert trust.judge(received(START + PERIOD, east, north, yaw, speed)) == "impossible"
