"""A clock with an error: its readings, and the age of received poses."""

from hypothesis import given
from hypothesis import strategies as st

from tests.made.transport.received_poses import received
from vehicles.car.clock import VehicleClock

START = 1_700_000_000_000_000_000
errors = st.integers(-10_000_000_000, 10_000_000_000)
drifts = st.sampled_from([-1000.0, -20.0, 0.0, 3.5, 1000.0])


@given(errors, drifts, st.integers(0, 10**13))
def test_the_error_is_offset_plus_drift(offset: int, drift: float, since: int) -> None:
    clock = VehicleClock(START, offset, drift)
    assert clock.error(START) == offset
    assert abs(clock.error(START + since) - offset - drift * since / 1e6) <= 1
    assert clock.reading(START + since) == START + since + clock.error(START + since)


@given(errors, errors, drifts, st.integers(0, 10**12))
def test_an_age_is_the_difference_of_two_clock_readings(
    mine: int, theirs: int, drift: float, since: int
) -> None:
    sender, receiver = VehicleClock(START, theirs), VehicleClock(START, mine, drift)
    measured_at, now = START + since, START + since + 70_000_000
    pose = received(sender.reading(measured_at), 0.0, 0.0)
    (restamped,) = receiver.restamped(now, [pose])
    assert now - restamped.measured_at == receiver.reading(now) - sender.reading(measured_at)
    assert restamped.message == pose.message
