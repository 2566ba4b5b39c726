"""Deliveries over a distance: by tables and path loss, on every link."""

from math import inf, log10, nan, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import norm

from tests.made.channels.laws import for_link
from tests.made.examples import examples
from transport.links.laws.link_law import (
    Effect,
    LinkSetting,
    Position,
    Road,
    TransmissionContext,
    VehiclesBetween,
)
from transport.links.laws.radio import (
    ErrorCurve,
    LossPerVehicle,
    PathLossRadio,
    Shadowing,
    SingleLoss,
    highway_loss,
    noise_power,
)
from transport.links.laws.shared_channel import Reservations, TableRadio
from transport.links.link import keyed_draw

DRAW = keyed_draw(7, "v1", "v2")
STRAIGHT = Road(10.0, (0.0, 10.0), (0.0, 0.0))


def table(
    distance_m: tuple[float, ...],
    delivery_ratio: tuple[float, ...],
    keep_ratio: float | None = None,
) -> TableRadio:
    """With reservations of 5 to 15 messages if `keep` is set."""
    law = TableRadio(
        distance_m=distance_m,
        delivery_ratio=delivery_ratio,
        burst="independent" if keep_ratio is None else "reservation",
        keep_ratio=keep_ratio or 0.0,
    )
    return for_link(law)


def apart(seq: int, distance: float, travelled: float = 0.0) -> TransmissionContext:
    """Message `seq` over `distance` (m) of straight road; `travelled` (m) by the receiver."""
    ahead = Position(travelled + distance, 0.0, travelled + distance)
    return TransmissionContext(seq, 0, 0, ahead, Position(travelled, 0.0, travelled))


# ---- Tables


def test_a_table_is_linear_between_its_points_constant_before_and_ends_with_the_last() -> None:
    law = table((50.0, 100.0, 200.0), (0.9, 0.5, 0.1))
    distances = (0.0, 49.0, 50.0, 75.0, 100.0, 150.0, 200.0, 200.001, inf, nan)
    expected = (0.9, 0.9, 0.9, 0.7, 0.5, 0.3, 0.1, 0.0, 0.0, 0.0)
    assert [law.ratio(distance) for distance in distances] == pytest.approx(expected)
    assert table((100.0,), (0.4,)).ratio(30.0) == 0.4


def test_a_message_without_a_position_is_out_of_range() -> None:
    receiver = Position(0.0, 0.0, 0.0)
    laws: list[Effect] = [table((1000.0,), (1.0,)), behind(3)]
    for place in (nan, inf, -inf, 1e308):
        sender = Position(place, place, place)
        assert {
            law.judge(DRAW, TransmissionContext(1, 0, 0, sender, receiver)) for law in laws
        } == {"range"}
    strange = Position(20.0, 0.0, nan)
    assert behind(3).judge(DRAW, TransmissionContext(1, 0, 0, strange, receiver)) == "range"
    assert (
        behind(3).judge(DRAW, TransmissionContext(1, 0, 0, Position(9.0, 0.0, 1e308), receiver))
        == 0
    )


def test_with_reservations_all_messages_of_one_share_their_fate() -> None:
    held = Reservations(5, 15, 0.4)
    law = table((100.0,), (0.6,), 0.4)
    fates: dict[int, set[object]] = {}
    for seq in range(2_000):
        selected = held.selected_at(DRAW, seq)
        fates.setdefault(selected, set()).add(law.judge(DRAW, apart(seq, 50.0)))
    assert all(len(fate) == 1 for fate in fates.values())
    assert set.union(*fates.values()) == {0, "range"}


# ---- Path loss


def test_the_budget_is_that_of_the_formulas() -> None:
    """By hand: −174 dBm/Hz in 10 MHz and 9 dB are −95 dBm; 3GPP's highway has 47.82 dB at 1 m."""
    assert noise_power(10e6, 9.0) == pytest.approx(-95.0)
    assert highway_loss(5.9e9) == pytest.approx(47.817, abs=1e-3)
    assert behind(0).snr(100.0) == pytest.approx(23.0 + 95.0 - 47.817 - 40.0, abs=1e-3)


def test_errors_are_those_of_the_points_and_on_a_line_in_deviations() -> None:
    curve = ErrorCurve((1.0, 3.1, 5.2), (0.5, 0.1, 0.01))
    for snr, error in ((1.0, 0.5), (3.1, 0.1), (5.2, 0.01)):
        assert curve.received(snr) == pytest.approx(1.0 - error)
    middle = norm.cdf(0.5 * (norm.ppf(0.9) + norm.ppf(0.99)))
    assert curve.received(4.15) == pytest.approx(middle)
    assert curve.received(-1.1) == pytest.approx(0.1)  # as far below 1 dB as 3.1 dB is above
    assert curve.received(-200.0) == 0.0
    assert curve.received(200.0) == 1.0
    with pytest.raises(ValueError, match="two points"):
        ErrorCurve((1.0,), (0.5,))


def behind(count: int, lorries: bool | None = None) -> PathLossRadio:
    """802.11p behind vehicles on a straight, by ETSI, or by 3GPP for lorries or cars."""
    obstruction: LossPerVehicle | SingleLoss = LossPerVehicle()
    if lorries is not None:
        mean, deviation = (9.0, 4.5) if lorries else (5.0, 4.0)
        obstruction = SingleLoss(mean_db=mean, deviation_db=deviation)
    shadowing = Shadowing(deviation_db=3.0, obstructed_deviation_db=3.0)
    law = PathLossRadio(shadowing=shadowing, obstruction=obstruction)
    setting = LinkSetting(between=lambda: VehiclesBetween(count, STRAIGHT, 0.0, 0.0))
    return for_link(law, setting)


NORMAL = norm.ppf((np.arange(20_000) + 0.5) / 20_000)


def received(distance: float, lost: float | NDArray[np.float64], *, sight: bool = False) -> float:
    """Independent computation: the curve in scipy, averaged over quantiles."""
    points = (1.0, 3.1, 5.2) if sight else (4.7, 6.8, 8.6)
    scores = norm.ppf((0.5, 0.9, 0.99))
    snr = 23.0 + 95.0 - 32.4 - 20.0 * log10(distance) - 20.0 * log10(5.9) - lost + 3.0 * NORMAL
    score = np.interp(snr, points, scores)
    low, high = np.diff(scores) / np.diff(points)
    score += np.minimum(snr - points[0], 0.0) * low + np.maximum(snr - points[-1], 0.0) * high
    return float(np.mean(norm.cdf(score)))


def lorry(mean: float, deviation: float) -> NDArray[np.float64]:
    other = np.random.default_rng(1).permutation(NORMAL)
    return np.maximum(0.0, mean + deviation * other)


PUBLISHED = {
    "ETSI, 5th ahead": (behind(4), 75.0, 0.54, 0.01, received(75.0, 27.6)),
    "ETSI, 6th ahead": (behind(5), 90.0, 0.007, 0.003, received(90.0, 34.5)),
    "3GPP, lorries": (behind(9, True), 150.0, 0.989, 0.001, received(150.0, lorry(9.0, 4.5))),
}


@pytest.mark.campaign(3_000, 30_000)
@pytest.mark.parametrize("which", PUBLISHED)
def test_vehicles_in_between_reduce_the_delivery_as_published(which: str, campaign: int) -> None:
    """15 m apart, 23 dBm, noise figure 9 dB, no interference; over 2.5 decorrelation distances."""
    law, distance, known, tolerance, expected = PUBLISHED[which]
    assert expected == pytest.approx(known, abs=tolerance)
    delivered = sum(
        law.judge(DRAW, apart(seq, distance, 62.5 * seq)) == 0 for seq in range(campaign)
    )
    error = sqrt(expected * (1.0 - expected) / campaign)
    assert abs(delivered / campaign - expected) < 4.5 * error


def test_shadowing_makes_losses_of_messages_near_one_another_alike() -> None:
    """Deliveries a metre apart are correlated, those 100 m apart are not."""
    law, distance = behind(4), 75.0
    fates = [law.judge(DRAW, apart(seq, distance, float(seq))) == 0 for seq in range(6_000)]
    mean = sum(fates) / len(fates)
    near, far = (
        sum((a - mean) * (b - mean) for a, b in zip(fates, fates[lag:], strict=False))
        / (len(fates) * mean * (1.0 - mean))
        for lag in (1, 100)
    )
    assert near > 0.4
    assert abs(far) < 0.1


# ---- All radios


LAWS: dict[str, Effect] = {
    "table": table((0.0, 200.0), (1.0, 0.0)),
    "reservations": table((0.0, 200.0), (1.0, 0.0), 0.4),
    "etsi": behind(4),
    "3gpp": behind(9, True),
}


@pytest.mark.parametrize("name", LAWS)
@examples(5, 15)
@given(data=st.data())
def test_a_verdict_alone_is_that_of_the_stream(name: str, data: st.DataObject) -> None:
    """On three links with one law and its caches, in any order."""
    links = [keyed_draw(data.draw(st.integers(0, 2**40)), "v1", receiver) for receiver in "abc"]
    distances = data.draw(st.lists(st.floats(1.0, 250.0), min_size=5, max_size=20))
    contexts = [apart(seq, distance, 1.5 * seq) for seq, distance in enumerate(distances)]
    stream = [[LAWS[name].judge(draw, context) for draw in links] for context in contexts]
    for context in data.draw(st.permutations(contexts)):
        fresh = fresh_law(name)
        assert [fresh.judge(draw, context) for draw in links] == stream[context.seq]


def fresh_law(name: str) -> Effect:
    if name == "table":
        return table((0.0, 200.0), (1.0, 0.0))
    if name == "reservations":
        return table((0.0, 200.0), (1.0, 0.0), 0.4)
    return behind(4) if name == "etsi" else behind(9, True)
