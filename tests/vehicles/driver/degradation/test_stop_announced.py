"""Announced stop of a follower, from its reception and its predecessor's announcement."""

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.transport.received_poses import received
from tests.made.vehicles.exact_drives import START
from vehicles.driver.degradation.settings import DegradationSettings, Reaction
from vehicles.driver.degradation.source import Source
from vehicles.driver.degradation.sources import Sources
from vehicles.driver.ego.own_state import Pose
from vehicles.messages import Announcement, Mode
from vehicles.schedule import MILLISECOND, SECOND

TICK, PERIOD, LATENCY, SPEED = 20 * MILLISECOND, 50 * MILLISECOND, 20 * MILLISECOND, 20.0
LOST_AFTER, OVERDUE = 500 * MILLISECOND, 75 * MILLISECOND


class Reception:
    """A pair whose lead and predecessor are received until two instants (s)."""

    def __init__(
        self,
        lead_until: float,
        ahead_until: float,
        *,
        reaction: Reaction = "degrade",
        announced: int = 0,
        brakes_at: int = 0,
    ) -> None:
        settings = DegradationSettings(reaction=reaction)
        lead, ahead = (Source(name, PERIOD / SECOND, settings) for name in ("v1", "v2"))
        self.sources = (lead, ahead)
        self.pair = Sources(
            [lead, ahead], settings, lead="v1", predecessor="v2", lateral=["v1", "v2"]
        )
        self.until = {"v1": lead_until, "v2": ahead_until}
        self.announced = announced
        self.brakes_at = brakes_at
        self.last = {"v1": 0, "v2": 0}

    def looks(self, seconds: float, mode: Mode = "composite") -> Iterator[tuple[int, int]]:
        """Instants, and the announced instant of the follower's stop."""
        sent = START
        for tick in range(round(seconds * 50)):
            now = START + tick * TICK
            while sent + LATENCY <= now:
                self._receive(now, sent)
                sent += PERIOD
            for source in self.sources:
                source.usable = True
            self.pair.assess(now, Pose(0.0, 0.0, 0.0, SPEED, 0.0), 0.0, refit=True)
            yield now, self.pair.stops_at(mode, self.brakes_at)

    def _receive(self, now: int, sent: int) -> None:
        for source, gap in zip(self.sources, (30.0, 15.0), strict=True):
            if sent - START >= self.until[source.name] * SECOND:
                continue
            east, seq = gap + SPEED * (sent - START) / SECOND, (sent - START) // PERIOD
            announcement = Announcement(stops_at_ns=self.announced if source.name == "v2" else 0)
            pose = received(
                sent,
                east,
                0.0,
                0.0,
                SPEED,
                seq=seq,
                vehicle=source.name,
                received_at=now,
                announced=announcement,
            )
            source.receive(pose)
            self.last[source.name] = now


def test_usual_reception_announces_no_stop() -> None:
    assert {stops for _, stops in Reception(9.0, 9.0).looks(3.0)} == {0}


@pytest.mark.parametrize("silent", ["lead", "predecessor"])
def test_one_remaining_source_announces_no_stop(silent: str) -> None:
    reception = Reception(*((1.0, 9.0) if silent == "lead" else (9.0, 1.0)))
    assert {stops for _, stops in reception.looks(3.0)} == {0}


@given(st.floats(0.5, 2.0), st.floats(0.5, 2.0))
def test_without_both_it_announces_the_loss_of_the_later_one(lead: float, ahead: float) -> None:
    reception = Reception(lead, ahead)
    looks = list(reception.looks(3.0))
    last = max(reception.last.values())
    for now, stops in looks:
        if now > last + OVERDUE:
            assert stops == pytest.approx(last + LOST_AFTER, abs=2)  # also once it is lost
        elif now <= last:
            assert stops == 0
    # It is lost from the first tick after that instant.
    lost = [now for now, _ in looks if now > last + LOST_AFTER]
    assert lost


@pytest.mark.parametrize("ahead_until", [1.0, 9.0])
def test_braking_by_the_guard_is_announced_in_any_case(ahead_until: float) -> None:
    reception = Reception(9.0, ahead_until, brakes_at=START + SECOND)
    assert {stops for _, stops in reception.looks(3.0)} == {START + SECOND}


def test_the_earlier_of_loss_and_guard_is_announced() -> None:
    for brakes_at in (START, START + 9 * SECOND):
        reception = Reception(1.0, 1.0, brakes_at=brakes_at)
        *_, (_, stops) = reception.looks(3.0)
        lost = max(reception.last.values()) + LOST_AFTER
        assert stops == pytest.approx(min(brakes_at, lost), abs=2)


def test_reception_withdraws_the_announcement() -> None:
    reception = Reception(1.0, 1.0)
    for now, stops in reception.looks(3.0):
        if now == START + 1300 * MILLISECOND:
            assert stops > now
            reception.until = {"v1": 9.0, "v2": 9.0}
        if now > START + 1350 * MILLISECOND:
            assert stops == 0


def test_a_coasting_car_announces_no_stop() -> None:
    assert {stops for _, stops in Reception(1.0, 1.0).looks(3.0, "coast")} == {0}


@given(st.integers(-500, 3000))
def test_it_stops_no_later_than_its_predecessor(announced_ms: int) -> None:
    announced = START + announced_ms * MILLISECOND
    reception = Reception(1.0, 1.0, announced=announced)
    for now, stops in reception.looks(3.0):
        last = max(reception.last.values())
        if now > START + 2 * TICK:
            alone = last + LOST_AFTER if now > last + OVERDUE else announced
            assert stops == pytest.approx(min(announced, alone), abs=2)


@pytest.mark.parametrize("reaction", ["extrapolate", "hold", "straight"])
def test_the_baselines_never_stop(reaction: Reaction) -> None:
    assert {
        stops for _, stops in Reception(1.0, 1.0, reaction=reaction, announced=1).looks(3.0)
    } == {0}


def test_a_missing_first_message_announces_a_stop() -> None:
    """After 1.5 periods, as for any other message; the later of both sources counts."""
    for now, stops in Reception(0.0, 0.0).looks(2.0, "straight"):
        assert stops == (START + LOST_AFTER if now > START + OVERDUE else 0)


def test_a_first_message_withdraws_the_announcement() -> None:
    reception = Reception(0.0, 0.0)
    for now, stops in reception.looks(2.0, "straight"):
        if now == START + 300 * MILLISECOND:
            assert stops > now
            reception.until["v1"] = 9.0
        if now > START + 350 * MILLISECOND:
            assert stops == 0
