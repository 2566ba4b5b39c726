"""Which entry of a scenario counts for a link: names before roles before "*", ties refused."""

import itertools

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, load_scenario


def with_entries(*entries: str) -> Scenario:
    return load_scenario("lane_change", [f"link=[{', '.join(entries)}]"])


def losses(*entries: str) -> dict[tuple[str, str], float]:
    return {pair: link.loss_ratio for pair, link in with_entries(*entries).links.items()}


def test_roles_stand_for_vehicles_by_their_place() -> None:
    of_lead = losses('{sender="lead", receiver="follower", loss_ratio=0.5}')
    assert {pair for pair, loss in of_lead.items() if loss} == {
        ("v1", "v2"), ("v1", "v3"), ("v1", "v4"),
    }  # fmt: skip
    ahead = losses('{sender="predecessor", receiver="*", loss_ratio=0.5}')
    assert {pair for pair, loss in ahead.items() if loss} == {
        ("v1", "v2"), ("v2", "v3"), ("v3", "v4"),
    }  # fmt: skip
    assert {
        pair for pair, loss in losses('{sender="follower", receiver="*", loss_ratio=0.5}').items()
        if loss
    } == {("v2", "v1"), ("v3", "v1"), ("v2", "v3"), ("v3", "v4")}  # fmt: skip


def test_a_name_comes_before_a_role_and_a_role_before_any_in_whatever_order() -> None:
    entries = [
        '{sender="*", receiver="*", loss_ratio=0.1, jitter_ms=7.0}',
        '{sender="lead", receiver="*", loss_ratio=0.2}',
        '{sender="lead", receiver="follower", loss_ratio=0.3}',
        '{sender="lead", receiver="v3", loss_ratio=0.4}',
        '{sender="v1", receiver="v4", loss_ratio=0.5}',
    ]
    for order in itertools.permutations(entries):
        scenario = with_entries(*order)
        assert {pair: link.loss_ratio for pair, link in scenario.links.items()} == {
            ("v1", "v2"): 0.3, ("v1", "v3"): 0.4, ("v1", "v4"): 0.5,
            ("v2", "v3"): 0.1, ("v3", "v4"): 0.1, ("v2", "v1"): 0.1, ("v3", "v1"): 0.1,
        }  # fmt: skip
        assert all(link.jitter_ms == 7.0 for link in scenario.links.values())


def test_a_tie_is_refused_with_both_entries_and_the_key() -> None:
    with pytest.raises(ScenarioError, match=r"link\[1\]\.loss_ratio: given by link\[0\] too"):
        losses(
            '{sender="lead", receiver="*", loss_ratio=0.2}',
            '{sender="*", receiver="follower", loss_ratio=0.3}',
        )


def test_every_entry_without_a_link_gets_a_line() -> None:
    with pytest.raises(ScenarioError) as caught:
        with_entries('{sender="v8", receiver="v2"}', '{sender="v1", receiver="v9"}')
    assert [line.split(": ")[1] for line in caught.value.lines] == [
        "link[0].sender", "link[1].receiver",
    ]  # fmt: skip
