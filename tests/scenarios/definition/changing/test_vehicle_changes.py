"""Changes that cannot be carried out: one clear line each, with what would be right."""

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, scenario_from_text
from tests.made.scenarios.messages import STRAIGHT

STALL = 'kind = "stall"\nvehicle = "v2"\nat_s = {at}\nfor_s = {span}'
CRASH = 'kind = "crash"\nvehicle = "v2"\nat_s = {at}\nfor_s = {span}'
LEAVE = 'kind = "leave"\nvehicle = "{who}"\nat_s = {at}'
JOIN = 'kind = "join"\nvehicle = "{who}"\nat_s = {at}'


def made(*changes: str, rest: str = "") -> Scenario:
    return scenario_from_text(
        STRAIGHT + rest + "".join(f"\n[[change]]\n{one}\n" for one in changes), label="a.toml"
    )


REFUSED = {
    "a stranger": (
        (STALL.replace("v2", "v9").format(at=1, span=1),),
        ("change[0].vehicle", 'given "v9"', "allowed v1"),
    ),
    "too late": ((STALL.format(at=20, span=1),), ("change[0].at_s", "given 20", "less than")),
    "a lead that leaves": (
        (LEAVE.format(who="v1", at=1),),
        ("change[0].vehicle", "the lead", "cannot leave"),
    ),
    "a lead that joins": (
        (JOIN.format(who="v1", at=1),),
        ("change[0].vehicle", "the lead", "cannot join"),
    ),
    "left twice": (
        (LEAVE.format(who="v2", at=1), LEAVE.format(who="v2", at=2)),
        ("change[1]", "v2: leave at 2 s", "it has left at 1 s"),
    ),
    "joined twice": (
        (JOIN.format(who="v2", at=1), JOIN.format(who="v2", at=2)),
        ("change[1]", "v2 joins at 2 s", "in the convoy"),
    ),
    "a stall before joining": (
        (STALL.format(at=1, span=1), JOIN.format(who="v2", at=2)),
        ("change[0]", "v2: stall at 1 s", "not joined yet"),
    ),
    "a stall while down": (
        (CRASH.format(at=1, span=3), STALL.format(at=2, span=1)),
        ("change[1]", "v2: stall at 2 s", "it is down until 4 s"),
    ),
    "a crash while it stalls": (
        (STALL.format(at=1, span=3), CRASH.format(at=2, span=1)),
        ("change[1]", "v2: crash at 2 s", "it stalls until 4 s"),
    ),
    "anything after the last crash": (
        ('kind = "crash"\nvehicle = "v2"\nat_s = 1', STALL.format(at=5, span=1)),
        ("change[1]", "v2: stall at 5 s", "it is down until inf s"),
    ),
    "too short to restart": (
        (CRASH.format(at=1, span=0.5),),
        ("change[0].for_s", "given 0.5", "1 to 86400"),
    ),
    "no acceleration": (
        ('kind = "speed"\nat_s = 1\nspeed_mps = 3\nacceleration_mps2 = 0',),
        ("change[0].acceleration_mps2", "given 0", "0.1 to 12"),
    ),
}


@pytest.mark.parametrize(("changes", "facts"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_carried_out_is_refused_in_one_line(
    changes: tuple[str, ...], facts: tuple[str, ...]
) -> None:
    with pytest.raises(ScenarioError) as caught:
        made(*changes)
    (line,) = caught.value.lines
    assert line.startswith("a.toml: change[")
    for part in facts:
        assert part in line


def test_a_clock_that_drifts_too_far_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"vehicle\.v2\.clock\.drift_ppm.*at most 10000"):
        made(rest="[vehicle.v2.clock]\noffset_ms = 9990.0\ndrift_ppm = 1000.0\n")
    clock = made(rest="[vehicle.v2.clock]\noffset_ms = -900.0\ndrift_ppm = 1000.0\n")
    assert clock.clock_error_ns("v2") == 900_000_000
    assert clock.clock_error_ns("v1") == 0


def test_whose_first_part_is_to_join_is_not_there_at_first() -> None:
    late = made(LEAVE.format(who="v2", at=9), JOIN.format(who="v2", at=2))
    assert late.joins_late("v2")
    back = made(LEAVE.format(who="v2", at=2), JOIN.format(who="v2", at=9))
    assert not back.joins_late("v2")
    assert not back.joins_late("v1")
