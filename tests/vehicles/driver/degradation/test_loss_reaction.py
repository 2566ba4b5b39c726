"""Along the road, followers that lose messages drive as careful drivers: the law acts, no one hits.

Simulated convoys on a straight with the follower's own decisions; campaigns are small by default.
"""

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest

from tests.made.convoys.straight_convoy import STEP, Cut, Lead, StraightConvoy
from vehicles.driver.controller import GapLimits
from vehicles.driver.settings import DegradationSettings

LAWS: dict[str, tuple[str, float, float]] = {
    "same": ("same", 3.0, 0.0),
    "gap": ("gap", 3.0, 0.0),
    "headway": ("gap", 2.0, 0.4),
    "cacc": ("cacc", 5.0, 0.0),
    "ploeg": ("ploeg", 2.0, 0.5),
}
"""Law, standstill gap (m) and headway (s)."""
COMFORT, STARTED = 1.5, 0.1


def convoy(law: str, *, count: int = 8, **settings: object) -> StraightConvoy:
    name, standstill, headway = LAWS[law]
    values: dict[str, object] = {"standstill": standstill, "headway": headway, **settings}
    return StraightConvoy(law=name, count=count, **values)  # type: ignore[arg-type]


def braking(deceleration: float, at: float, final: float = 0.0) -> Lead:
    return lambda time, speed: -deceleration if time >= at and speed > final else 0.0


def swinging(amplitude: float = 1.0, frequency_hz: float = 0.2, lag: float = 0.0) -> Lead:
    """Speed that swings by `amplitude` (m/s) from 3 s on, the drive lag inverted."""
    rate = 2.0 * np.pi * frequency_hz

    def command(time: float, _speed: float) -> float:
        phase = rate * (time - 3.0)
        push = np.cos(phase) - lag * rate * np.sin(phase)
        return float(amplitude * rate * push) if time >= 3.0 else 0.0

    return command


@pytest.mark.campaign(1, 100)
@pytest.mark.parametrize("rate_hz", [10.0, 20.0])
@pytest.mark.parametrize("law", LAWS)
def test_loss_alone_makes_no_car_brake(law: str, rate_hz: float, campaign: int) -> None:
    """16 cars behind a lead at constant speed, at 40 % loss: the noise of the law remains."""
    beyond = 0
    for seed in range(campaign):
        run = convoy(law, count=16, seed=seed, rate_hz=rate_hz, loss=0.4).run(20.0)
        hardest = float(run.hardest(STARTED).max())
        beyond += hardest > COMFORT + 0.01
        assert hardest <= 2.5
        assert np.ptp(run.gaps, axis=0).max() < 3.0
        assert run.gaps.min() > 1.5
    assert beyond <= max(1, campaign // 100)


@pytest.mark.campaign(1, 20)
@pytest.mark.parametrize("law", ["gap", "cacc", "ploeg"])
def test_loss_amplifies_a_swing_no_more_than_the_law_itself(law: str, campaign: int) -> None:
    """Acceleration gain v8/v1 at 30 % loss, with the reaction over without one."""

    def gain(*, degrades: bool, seed: int) -> float:
        run = convoy(
            law, seed=seed, rate_hz=10.0, loss=0.3, lag=0.5, speed=27.8, lead=swinging(lag=0.5),
            degrades=degrades,
        ).run(33.0)  # fmt: skip
        swing = np.gradient(run.speeds[round(13.0 / STEP) :], STEP, axis=0).std(axis=0)
        return float(swing[-1] / swing[0])

    for seed in range(campaign):
        assert gain(degrades=True, seed=seed) <= 1.05 * gain(degrades=False, seed=seed)


CONTACTS = [
    *product(LAWS, (4.0, 6.0), (20.0,)),
    ("headway", 6.0, 10.0),
    ("ploeg", 6.0, 10.0),
    ("ploeg", 8.0, 20.0),
]


@pytest.mark.campaign(1, 100)
@pytest.mark.parametrize(("law", "deceleration", "rate_hz"), CONTACTS)
def test_no_contact_behind_a_lead_that_brakes_to_a_standstill(
    law: str, deceleration: float, rate_hz: float, campaign: int
) -> None:
    for seed in range(campaign):
        onset = 3.0 + 0.0171 * seed
        run = convoy(
            law, seed=seed, rate_hz=rate_hz, loss=0.4, lead=braking(deceleration, onset)
        ).run(14.0)
        assert run.gaps.min() > 0.0


@pytest.mark.campaign(1, 20)
@pytest.mark.parametrize("law", ["gap", "headway", "cacc", "ploeg"])
def test_stop_and_go_keeps_its_distance_without_braking_much_harder(
    law: str, campaign: int
) -> None:
    """Behind a lead that brakes at 3 m/s²: up to 5, but 6.5 at a constant gap of 3 m."""

    def lead(time: float, speed: float) -> float:
        phase = (time - 3.0) % 30.0 if time >= 3.0 else 29.0
        if phase < 14.0:
            return -3.0 if speed > 0.0 else 0.0
        return 1.5 if speed < 30.0 else 0.0

    for seed in range(campaign):
        run = convoy(law, seed=seed, loss=0.3, lead=lead).run(36.0)
        assert run.gaps.min() > 0.0
        assert run.hardest(STARTED).max() <= (6.5 if law == "gap" else 5.0)


def test_ordered_jitter_does_not_open_the_gaps() -> None:
    run = convoy("cacc", count=4, speed=20.0, jitter=0.3).run(30.0)
    assert np.ptp(run.gaps, axis=0).max() < 2.0


def link(sender: int, receiver: int) -> Callable[[int, int], bool]:
    return lambda s, r: (s, r) == (sender, receiver)


def radio_of(place: int) -> Callable[[int, int], bool]:
    return lambda s, r: place in (s, r)


@pytest.mark.parametrize("has_sensor", [False, True])
def test_a_broken_link_costs_comfortable_braking_only(has_sensor: bool) -> None:
    """The lead repeats what the silent predecessor announces, so it is known to drive on."""
    cut = Cut(begin=4.0, end=19.0, links=link(1, 2))
    run = convoy("gap", standstill=10.0, speed=20.0, cuts=(cut,), sensor=has_sensor).run(45.0)
    assert run.hardest(STARTED)[1] <= COMFORT
    assert run.hardest(STARTED).max() <= 2.0
    assert run.gaps.min() > 1.0
    assert run.gaps.max() < 31.0
    assert run.speeds.max() <= 22.1
    assert "alone" in run.states[2]
    assert np.abs(run.gaps[-1] - 10.0).max() < 0.5


def test_a_dead_radio_is_followed_to_its_stop() -> None:
    """v2 neither sends nor receives: it stops blindly, and so does v3, which learns of nothing."""
    cut = Cut(begin=4.0, end=60.0, links=radio_of(1))
    run = convoy("gap", standstill=10.0, cuts=(cut,)).run(20.0)
    assert run.gaps.min() > 0.0
    assert run.speeds[-1, 1:3].max() < 0.1
    assert "announced stop" in run.overrides[2]


@pytest.mark.campaign(6, 200)
@pytest.mark.parametrize("brakes", [False, True])
def test_no_contact_in_random_cuts(brakes: bool, campaign: int) -> None:
    """Cuts of 0.2 to 8 s of all links, the lead's, one link or one radio; 10 m and 20 Hz."""
    for seed in range(campaign):
        random = np.random.default_rng(1000 + seed)
        begin, place = 5.0 + random.random(), int(random.integers(1, 6))
        span = float(np.exp(random.uniform(np.log(0.2), np.log(8.0))))
        kinds = (
            lambda _s, _r: True,
            lambda s, _r: s == 0,
            link(place, place + 1),
            radio_of(place),
        )
        cut = Cut(begin=begin, end=begin + span, links=kinds[seed % 4])
        lead = (
            braking(3.0, begin + random.uniform(-1.0, 4.0), 15.0) if brakes else braking(0.0, 0.0)
        )
        run = convoy("gap", standstill=10.0, seed=seed, cuts=(cut,), lead=lead).run(
            begin + span + 17.0
        )
        assert run.gaps.min() > 0.0, (seed, span, place)
        assert run.speeds.max() <= 33.1
        assert run.speeds[-1].min() >= 0.89 * run.speeds[-1, 0]


def test_gap_sensor_prevents_contacts_in_long_bursts() -> None:
    for seed, (ratio, mean, rate_hz) in enumerate([(0.2, 6.0, 10.0), (0.3, 10.0, 20.0)]):
        run = convoy(
            "gap", standstill=10.0, seed=seed, loss=ratio, burst=mean, rate_hz=rate_hz, sensor=True
        ).run(20.0)
        assert run.gaps.min() > 0.0


def test_a_law_is_not_overridden_while_all_is_received() -> None:
    run = convoy("cacc", lead=braking(3.0, 4.0, 15.0)).run(15.0)
    assert {word for words in run.overrides[1:] for word in words[1:]} <= {""}


def test_braking_beyond_comfort_needs_evidence() -> None:
    """A law that brakes hard for no reason, here at 4 m/s², is kept to comfortable braking."""

    class Nervous:
        def acceleration(self, _speed: float, _ahead: object) -> float:
            return -4.0

    run = convoy("gap", count=2, standstill=20.0)
    run.controller = Nervous()
    run.run(4.0)
    assert run.hardest(STARTED).max() == pytest.approx(COMFORT)
    assert "unproven" in run.overrides[1]


@pytest.mark.parametrize("deceleration", [2.0, 6.0])
def test_a_blind_stop_ends_within_the_known_path(deceleration: float) -> None:
    settings = DegradationSettings(emergency_deceleration=deceleration)
    cut = Cut(begin=4.0, end=60.0)
    run = convoy(
        "gap", count=3, standstill=60.0, speed=12.0, cuts=(cut,), degradation=settings,
        limits=GapLimits(),
    ).run(30.0)  # fmt: skip
    assert run.speeds[-1, 1:].max() < 0.1
    newest = run.places[round(4.0 / STEP)]  # of the cars ahead when they were received last
    assert run.places[-1, 1] <= newest[0] + 1.0
    assert -run.accelerations[:, 1:].min() <= deceleration + 1e-9
