"""Tables generated from settings classes: keys with units, bounds, SI values."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import pytest
from pydantic import TypeAdapter, ValidationError

from scenarios.definition.schema.settings_table import SettingsTable, one_of, table_with
from vehicles.setting import Setting


@dataclass(frozen=True)
class Drift:
    deviation: Annotated[float, Setting("per axis", "m", minimum=0, maximum=10)]


@dataclass(frozen=True)
class Circle:
    radius: Annotated[float, Setting("of the circle", "m", above=0)]


@dataclass(frozen=True)
class Sensor:
    angle: Annotated[float, Setting("of its axis", "deg", -90, 90)] = math.radians(0.1)
    wait_max: Annotated[float, Setting("at most", "ms")] = 0.25
    late: Annotated[int, Setting("delay", "ms", 0, 5000)] = 0
    places: Annotated[tuple[float, ...], Setting("of it", "m", maximum=5)] = ()
    word: Annotated[Literal["a", "b"], Setting("which", name="kind_of_word")] = "a"
    drift: Annotated[Drift | None, Setting("if any")] = None
    blind: Annotated[tuple[object, ...], Setting(kinds={"circle": Circle, "drift": Drift})] = ()


Keys = SettingsTable[Sensor]


def test_defaults_are_those_of_the_class() -> None:
    assert Keys().value == Sensor()
    assert Keys().model_dump()["angle_deg"] == 0.1
    assert Keys().model_dump()["wait_ms_max"] == 250.0


def test_values_are_si_and_whole_times_nanoseconds() -> None:
    table = Keys.model_validate(
        {
            "angle_deg": 90.0,
            "wait_ms_max": 100.0,
            "late_ms": 1.5,
            "places_m": [1, 2.5],
            "drift": {"deviation_m": 2},
            "blind": [{"kind": "circle", "radius_m": 3.0}],
        }
    )
    sensor = Sensor(math.pi / 2, 0.1, 1_500_000, (1.0, 2.5), "a", Drift(2.0), (Circle(3.0),))
    assert table.value == sensor
    assert table_with(sensor) == table


@pytest.mark.parametrize(
    "wrong",
    [
        {"angle_deg": 91.0},
        {"places_m": [6.0]},
        {"drift": {"deviation_m": -1.0}},
        {"drift": {}},
        {"blind": [{"kind": "circle", "radius_m": 0.0}]},
        {"blind": [{"kind": "square"}]},
        {"late": 1.0},
        {"late_ms": "1"},
    ],
)
def test_what_the_class_does_not_allow_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Keys.model_validate(wrong)


def test_a_table_is_one_of_several_by_its_kind() -> None:
    table = TypeAdapter(one_of({"circle": Circle, "drift": Drift})).validate_python(
        {"kind": "drift", "deviation_m": 1.0}
    )
    assert table.value == Drift(1.0)
