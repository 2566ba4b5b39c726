"""Deadlines that no run could keep are refused in a clear line each."""

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from tests.made.scenarios.messages import STRAIGHT

MODE = {"vehicle": '"v3"', "mode": '"predecessor"', "after_s": "5.0", "within_s": "1.0"}
SOURCE = {"vehicle": '"v3"', "source": '"v2"', "status": '"lost"', "within_s": "1.0"}
RECOVERY = {"vehicle": '"v3"', "error_m": "0.3", "after_s": "5.0", "within_s": "1.0"}


def made(kind: str, table: dict[str, str], **keys: str) -> Scenario:
    lines = "\n".join(f"{key} = {value}" for key, value in (table | keys).items())
    return scenario_from_text(f"{STRAIGHT}\n[[limits.{kind}]]\n{lines}\n", label="a.toml")


def test_what_can_be_kept_is_taken() -> None:
    limits = made("modes", MODE, within_s="15.0").tables.limits  # to the very end
    assert limits.modes[0].mode == "predecessor"
    assert made("sources", SOURCE).tables.limits.sources[0].after_s == 0.0
    assert made("sources", SOURCE, source='"v1"').tables.limits.sources[0].source == "v1"
    assert made("recovery", RECOVERY).tables.limits.recovery[0].error_m == 0.3


REFUSED = {
    "a stranger": (
        ("modes", MODE, {"vehicle": '"v9"'}),
        'limits.modes[0].vehicle: given "v9", allowed a follower: v2, v3, v4',
    ),
    "the lead": (
        ("recovery", RECOVERY, {"vehicle": '"v1"'}),
        'limits.recovery[0].vehicle: given "v1", allowed a follower: v2, v3, v4',
    ),
    "a source that it does not receive from": (
        ("sources", SOURCE, {"vehicle": '"v4"'}),
        'limits.sources[0].source: given "v2", v4 does not receive from it, allowed v1 or v3',
    ),
    "itself": (
        ("sources", SOURCE, {"source": '"v3"'}),
        'limits.sources[0].source: given "v3", v3 does not receive from it, allowed v1 or v2',
    ),
    "a mode that the first follower cannot have": (
        ("modes", MODE, {"vehicle": '"v2"'}),
        'limits.modes[0].mode: given "predecessor", but v2 steers along v1 only, allowed '
        '"lead", "coast", "stop" or "straight"',
    ),
    "beyond the end": (
        ("modes", MODE, {"within_s": "15.1"}),
        "limits.modes[0].within_s: given 15.1 after 5 s, allowed together at most the run's 20",
    ),
    "an unknown mode": (
        ("modes", MODE, {"mode": '"fast"'}),
        'limits.modes[0].mode: given "fast", allowed "composite", "lead", "predecessor", '
        '"intermediate", "coast", "stop" or "straight"',
    ),
    "no time at all": (
        ("recovery", RECOVERY, {"within_s": "0.0"}),
        "limits.recovery[0].within_s: given 0.0, allowed more than 0, at most 86400",
    ),
    "an unknown key": (
        ("recovery", RECOVERY, {"error_cm": "3.0"}),
        "limits.recovery[0].error_cm: unknown key, did you mean limits.recovery[0].error_m = 0.03?",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_an_impossible_limit_gets_one_line(case: str) -> None:
    (kind, table, keys), line = REFUSED[case]
    with pytest.raises(ScenarioError) as refused:
        made(kind, table, **keys)
    assert str(refused.value) == f"a.toml: {line}"


def test_a_vehicle_that_moves_as_recorded_has_no_deadline() -> None:
    with pytest.raises(ScenarioError, match=r"modes\[0\].vehicle: .* is replayed"):
        load_scenario(
            "highway",
            [
                'vehicle.v3.replay="i280_highway.csv"',
                'limits.modes=[{vehicle="v3", mode="lead", within_s=1.0}]',
            ],
        )
