"""Messages kept of thinned topics."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from transport.topics import Thinning
from vehicles.schedule import MILLISECOND, SECOND

INSTANTS = st.lists(
    st.integers(min_value=0, max_value=5 * SECOND), min_size=1, max_size=60, unique=True
).map(sorted)


def kept(rates_hz: dict[str, float], instants: list[int], vehicle: str = "v1") -> list[int]:
    thinning = Thinning(rates_hz)
    return [at for at in instants if thinning.keeps("truth", vehicle, at)]


def test_a_topic_without_a_rate_is_whole_and_of_rate_0_there_is_none() -> None:
    ticks = [tick * 20 * MILLISECOND for tick in range(100)]
    assert kept({}, ticks) == kept({"command": 5.0}, ticks) == ticks
    assert kept({"truth": 0.0}, ticks) == []
    assert kept({"truth": 10.0}, ticks) == ticks[::5]
    assert Thinning({"truth": 0.0}).drops_all("truth")
    assert not Thinning({"truth": 1.0}).drops_all("truth")
    assert not Thinning({}).drops_all("truth")


def test_each_vehicle_and_topic_is_thinned_by_itself() -> None:
    thinning = Thinning({"truth": 1.0, "command": 1.0})
    requested = [("truth", "v1"), ("truth", "v2"), ("command", "v1"), ("truth", "v1")]
    assert [thinning.keeps(*arguments, 0) for arguments in requested] == [True, True, True, False]


@given(instants=INSTANTS, rate_hz=st.sampled_from([0.5, 1.0, 3.0, 10.0, 50.0]))
def test_the_first_of_each_period_is_kept_and_what_was_kept_is_kept_again(
    instants: list[int], rate_hz: float
) -> None:
    found = kept({"truth": rate_hz}, instants)
    period = round(SECOND / rate_hz)
    assert found[0] == instants[0]
    assert {at // period for at in found} == {at // period for at in instants}
    assert all(before // period < after // period for before, after in pairwise(found))
    assert kept({"truth": rate_hz}, found) == found
