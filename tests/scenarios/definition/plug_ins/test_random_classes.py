"""Classes that draw random numbers: the same in each run and alone."""

from collections.abc import Callable
from pathlib import Path

import pytest

import scenarios.api as convoy
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.schema.plug_ins.point import InstantDraw
from scenarios.runs.node.sink import BusSink
from scenarios.runs.virtual import VirtualConvoy
from tests.made.scenarios.random_classes import CODE, random_settings
from vehicles.messages import Command, Message

Module = Callable[[str], str]
SHORT = ("duration_s=0.4", "convoy.vehicles=3", "links.loss_ratio=0.3")


def scenario_of(name: str, *, seed: int = 1, places: slice = slice(None)) -> Scenario:
    """A second of three cars without noise of sensors or links, with some of the classes."""
    own = ["duration_s=1", "convoy.vehicles=3", "control.own_state=exact"]
    own += ["gnss.position_noise_m=0", "links.loss_ratio=0"]
    return load_scenario("lane_change", [*own, *random_settings(name)[places]], seed)


def commands(scenario: Scenario) -> dict[str, list[tuple[int, float, float]]]:
    """Instant, steering and acceleration of all commands of each vehicle."""
    convoy_of = VirtualConvoy(scenario)
    found: dict[str, list[tuple[int, float, float]]] = {}

    def on_sent(_: object, _data: bytes, message: Message) -> None:
        if isinstance(message, Command):
            row = message.decided_at_ns, message.steering_rad, message.acceleration_mps2
            found.setdefault(message.vehicle, []).append(row)

    convoy_of.build(lambda vehicle: BusSink(vehicle, convoy_of.bus, on_sent))
    convoy_of.run()
    return found


def test_a_number_depends_on_seed_vehicle_key_purpose_and_instant_only() -> None:
    def number(
        seed: int = 1,
        vehicle: str = "v2",
        key: str = "control.fusion",
        purpose: str = "mine",
        now: int = 20_000_000,
    ) -> float:
        draw = InstantDraw(seed, vehicle)
        draw.now = now
        return draw.of(key)(purpose)

    drawn = [
        number(),
        number(seed=2),
        number(vehicle="v3"),
        number(key="control.controller"),
        number(purpose="other"),
        number(now=20_000_001),
    ]
    assert len(set(drawn)) == 6
    assert all(0.0 < one < 1.0 for one in drawn)
    assert number() == drawn[0]
    draw = InstantDraw(1, "v2").of("control.fusion")
    mean = sum(draw(str(k)) for k in range(4000)) / 4000
    assert abs(mean - 0.5) < 4 * (1 / 12 / 4000) ** 0.5


@pytest.mark.parametrize("place", range(4))
def test_each_class_that_draws_changes_its_vehicles_by_the_seed(module: Module, place: int) -> None:
    name = module(CODE)
    places = slice(place, place + 1) if place != 1 else slice(1, 5, 3)
    first, again = (commands(scenario_of(name, places=places)) for _ in range(2))
    other = commands(scenario_of(name, seed=2, places=places))
    assert first == again
    assert first["v3"] != other["v3"]


@pytest.mark.filterwarnings("ignore:v. from 30.0 m/s a gap")
def test_random_decisions_are_replayed(module: Module, tmp_path: Path) -> None:
    text = load_scenario("lane_change", [*SHORT, *random_settings(module(CODE))]).text
    (tmp_path / "own.toml").write_text(text, encoding="utf-8")
    first = convoy.run(tmp_path / "own.toml", out=tmp_path / "first")
    again = convoy.replay(first, ["v1"], out=tmp_path / "again")
    assert again.vehicles["v3"].true.error_m.tolist() == first.vehicles["v3"].true.error_m.tolist()
