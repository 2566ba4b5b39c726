"""Limits of the command line and of scenario files, of all vehicles and of one."""

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.run_limits import Limit, limits_of, parsed_limit
from scenarios.definition.scenario import load_scenario
from scenarios.definition.schema.limit_rows import LIMITS, WORDS

CONVOY = ("v1", "v2", "v3")


@pytest.mark.parametrize("vehicle", ["", "v3"])
@pytest.mark.parametrize("word", WORDS)
def test_a_limit_is_written_as_it_was_read(word: str, vehicle: str) -> None:
    text = f"{vehicle}.{word}".lstrip(".") + ("" if WORDS[word].event else "=0.25")
    limit = parsed_limit(text, CONVOY)
    assert str(limit) == text
    assert (limit.key, limit.vehicle) == (WORDS[word].key, vehicle)
    assert list(limits_of(limit.table)) == [limit]


@pytest.mark.parametrize(
    "text",
    ["", "road", "lane=1", "error_m", "error_m=", "error_m=-1", "gap_m=nan", "gap_m=inf", "v2.",
     "v2.road", "v2.error_m", "v2=0.5"],
)  # fmt: skip
def test_a_limit_that_is_none_is_refused_with_the_known_ones(text: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        parsed_limit(text, CONVOY)
    for word in WORDS:
        assert word in str(refused.value)


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("v22.lane", "did you mean v2?"),
        ("lead.lane", "allowed v1, v2, v3"),
        ("v1.error_m=0.5", "v1 is the lead, allowed a follower: v2, v3"),
    ],
)
def test_a_limit_of_an_unknown_vehicle_or_a_lead_without_such_figure(text: str, hint: str) -> None:
    with pytest.raises(ScenarioError, match=f"--limit: given '{text}', .*{hint.rstrip('?')}"):
        parsed_limit(text, CONVOY)


@pytest.mark.parametrize(
    ("override", "refusal"),
    [
        ("limits.v22.stops_max=0", "limits.v22: no such vehicle, did you mean v2?"),
        ("limits.far.stops_max=0", "limits.far: no such vehicle, allowed v1, v2, v3, v4"),
        ("limits.v1.stops_max=0", "limits.v1.stops_max: v1 is the lead, allowed a follower"),
        ("limits.v2.stop_max=0", "unknown key, did you mean limits.v2.stops_max?"),
        ("limits.v2.modes=[]", "limits.v2.modes: unknown key"),
        ("limits.stop_max=0", "unknown key, did you mean limits.stops_max?"),
        ("limits.v2=0", "limits.v2: unknown key"),
        ("limits.v2.friction_ratio_max=2", "limits.v2.friction_ratio_max: given 2, allowed 0 to 1"),
    ],
)
def test_limits_of_single_vehicles_are_refused_where_they_stand(
    override: str, refusal: str
) -> None:
    with pytest.raises(ScenarioError) as refused:
        load_scenario("lane_change", [override])
    assert refusal in str(refused.value)


def test_a_limit_bounds_events_or_a_figure_on_the_side_that_its_key_names() -> None:
    for key, row in LIMITS.items():
        assert key.endswith(("_max", "_min"))
        assert bool(row.event) != bool(row.figure)
        assert bool(row.live) == bool(row.figure)
    assert Limit("true_gap_m_min", 2.0).is_beyond(1.9)
    assert not Limit("true_gap_m_min", 2.0).is_beyond(2.0)
    assert Limit("blind_m_max", 2.0).is_beyond(2.1)
