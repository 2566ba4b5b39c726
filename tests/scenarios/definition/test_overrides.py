"""Overrides: `--set key.path=value`."""

from typing import Any

import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.overrides import OverrideError, override, parse_override
from scenarios.definition.scenario import scenario_from_text
from tests.made.examples import examples
from tests.made.scenarios.messages import STRAIGHT


@examples(8, 50)
@given(
    key=st.lists(st.from_regex(r"\A[a-z_]{1,8}\Z"), min_size=1, max_size=4),
    value=st.one_of(
        st.integers(-(2**62), 2**62),
        st.floats(allow_nan=False),
        st.booleans(),
        st.lists(st.floats(-1e3, 1e3), max_size=3),
        st.text(st.characters(exclude_categories=["Cs"]), max_size=12),
    ),
)
def test_an_override_sets_just_the_value_that_it_gives(key: list[str], value: Any) -> None:
    written = tomli_w.dumps({"x": value}).removeprefix("x = ").rstrip("\n")
    parts, parsed = parse_override(f"{'.'.join(key)}={written}")
    table: dict[str, Any] = {"untouched": 1, key[0]: {}} if key[0] != "untouched" else {}
    override(table, parts, parsed)
    found: Any = table
    for part in key:
        found = found[part]
    assert found == value
    assert type(found) is type(value)


@examples(8, 50)
@given(alpha=st.floats(0, 1), latency=st.floats(0, 1000), seed=st.integers(0, 2**63 - 1))
def test_overrides_arrive_in_the_scenario_and_survive_its_text(
    alpha: float, latency: float, seed: int
) -> None:
    scenario = scenario_from_text(
        STRAIGHT,
        overrides=[
            f"control.alpha_ratio={alpha!r}",
            f"links.latency_ms={latency!r}",
            f"seed={seed}",
        ],
    )
    assert scenario.vehicle("v3").steering.alpha_ratio == alpha
    assert scenario.links["v2", "v3"].latency_ms == latency
    assert scenario.seed == seed
    assert scenario_from_text(scenario.text).tables == scenario.tables


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("change=[{kind='cut', at_s=7, for_s=2s}]", '"2s"'),
        ("change=[{kind=cut, at_s=7}]", '"cut"'),
        ("links.loss={ratio=}", '"}"'),
        ("path.east_m=[1, 2", "bracket"),
    ],
)
def test_an_invalid_list_or_table_names_its_invalid_part(text: str, part: str) -> None:
    with pytest.raises(OverrideError) as refused:
        parse_override(text)
    assert "not valid TOML" in str(refused.value)
    assert part in str(refused.value)
