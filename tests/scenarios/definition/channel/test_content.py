"""What a scenario may say of copies, wrong bits and false content, and what it may not."""

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario, scenario_from_text
from tests.made.scenarios.messages import STRAIGHT
from transport.links.laws.content import ContentLaw

CONTENT, FALSE = "links.content", "links.content.false[0]"
REFUSED = {
    "no table": ("links.content=3", CONTENT, "given 3", "a table"),
    "more than all": (f"{CONTENT}.duplicate_ratio=1.5", "duplicate_ratio", "given 1.5", "0 to 1"),
    "text": (f"{CONTENT}.reorder_ratio='often'", "reorder_ratio", 'given "often"', "a number"),
    "copy before": (f"{CONTENT}.duplicate_delay_ms=-1.0", "delay_ms", "given -1.0", "0 to 60000"),
    "not held": (f"{CONTENT}.reorder_delay_ms=0.0", "delay_ms", "given 0.0", "more than 0"),
    "number": (f"{CONTENT}.filter_duplicates=1", "filter_duplicates", "given 1", "true or false"),
    "too noisy": (f"{CONTENT}.bit_error_ratio=0.2", "bit_error_ratio", "given 0.2", "0 to 0.1"),
    "no number": (f"{CONTENT}.bit_error_ratio=nan", "bit_error_ratio", "given nan", "a finite"),
    "unit": (f"{CONTENT}.duplicate_delay_s=1", "duplicate_delay_s", "unknown", "delay_ms = 1000?"),
    "no list": (f"{CONTENT}.false=3", f"{CONTENT}.false", "given 3", "a list"),
    "unknown kind": (
        f"{CONTENT}.false=[{{kind='lie'}}]", f"{FALSE}.kind", 'given "lie"',
        'allowed "offset", "drift", "frozen", "replayed" or "ghost"',
    ),
    "no kind": (f"{CONTENT}.false=[{{}}]", f"{FALSE}.kind", "missing", '"frozen"'),
    "nothing before": (
        f"{CONTENT}.false=[{{kind='frozen', from_s=0.0}}]", f"{FALSE}.from_s", "given 0.0",
        "more than 0, at most 86400",
    ),
    "frozen when": (f"{CONTENT}.false=[{{kind='frozen'}}]", f"{FALSE}.from_s", "missing", ""),
    "too old": (
        f"{CONTENT}.false=[{{kind='replayed', age_s=61.0}}]", f"{FALSE}.age_s", "given 61.0",
        "at most 60",
    ),
    "key of another kind": (
        f"{CONTENT}.false=[{{kind='drift', left_m=1.0}}]", f"{FALSE}.left_m", "unknown",
        "left_mps?",
    ),
    "no offset": (
        f"{CONTENT}.false=[{{kind='offset'}}]", FALSE, "displaces nothing", "0 in east_m",
    ),
    "ghost inside its sender": (
        f"{CONTENT}.false=[{{kind='ghost', left_m=0.0}}]", FALSE, "displaces nothing", "ahead_m",
    ),
    "over before it began": (
        "link=[{sender='lead', receiver='v3', content={false=["
        "{kind='ghost', left_m=1.0}, {kind='offset', left_m=1.0, from_s=3.0, to_s=2.0}]}}]",
        "link[0].content.false[1].to_s", "given 2", "more than from_s, 3",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("change", "key", "given_", "allowed"), REFUSED.values(), ids=REFUSED)
def test_an_invalid_value_gets_one_line(change: str, key: str, given_: str, allowed: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(STRAIGHT, label="a.toml", overrides=[change])
    (line,) = caught.value.lines
    assert key in line
    assert given_ in line
    assert allowed in line
    assert len(line) < 250


def test_a_link_s_own_content_is_laid_over_the_convoy_s_key_by_key() -> None:
    scenario = load_scenario(
        "lane_change",
        [
            "links.content={duplicate_ratio=0.1, frame_check=false}",
            "link=[{sender='lead', receiver='v3', content={duplicate_ratio=0.2}}]",
        ],
    )
    found = {pair: link.content for pair, link in scenario.links.items()}
    assert found["v1", "v3"] == ContentLaw(duplicate_ratio=0.2, frame_check=False)
    assert found["v1", "v2"] == ContentLaw(duplicate_ratio=0.1, frame_check=False)
    assert load_scenario("lane_change").links["v1", "v2"].content is None
