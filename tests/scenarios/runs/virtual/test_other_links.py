"""What happens on a link does not depend on which other links, vehicles and rules there are."""

from pathlib import Path
from random import Random
from typing import Any

import pytest
import tomli_w

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.channels.drawn_channels import drawn_channel, drawn_spans
from transport.log.reader import LogReader
from vehicles.messages import LinkVerdict

Raw = dict[str, Any]
Pair = tuple[str, str]
SHARE = 0.35
"""Chance of each law for a link."""
BASE = """
extends = "lane_change"
name = "others"
duration_s = 1.2
[control.degradation]
reaction = "extrapolate"    # else the lead's message repeats what its followers announce
"""
OWN: tuple[Pair, ...] = (("v1", "v2"), ("v1", "v3"), ("v2", "v3"))
"""Links of a convoy of three."""
MORE: tuple[Pair, ...] = (("v1", "v4"), ("v3", "v4"), ("v1", "v5"), ("v4", "v5"))


def entry(chance: Random, pair: Pair) -> Raw:
    return {"sender": pair[0], "receiver": pair[1], **drawn_channel(chance, SHARE)}


def convoy(vehicles: int, entries: list[Raw], off: Raw) -> Scenario:
    tables = tomli_w.dumps({"convoy": {"vehicles": vehicles}, "link": entries, "vehicle": off})
    return scenario_from_text(BASE + tables)


def verdicts(scenario: Scenario, folder: Path) -> dict[Pair, dict[int, Raw]]:
    """Every verdict in the log, without the number of other verdicts."""
    run_virtual(scenario, folder, Stop())
    found: dict[Pair, dict[int, Raw]] = {}
    for _, _, message in LogReader(folder / "run.mcap").messages(("verdict",)):
        assert isinstance(message, LinkVerdict)
        reported = {name: getattr(message, name) for name in LinkVerdict.__slots__ if name != "seq"}
        found.setdefault((message.sender, message.vehicle), {})[message.pose_seq] = reported
    return found


@pytest.mark.campaign(4, 200)
def test_other_vehicles_links_and_rules_change_no_verdict(case: int, tmp_path: Path) -> None:
    chance = Random(case)
    entries = [entry(chance, pair) for pair in OWN]
    few = verdicts(convoy(3, entries, {}), tmp_path / "few")
    others = [entry(chance, pair) for pair in MORE]
    chance.shuffle(others)
    off = {"v4": {"receiver_off": drawn_spans(chance), "transmitter_off": drawn_spans(chance)}}
    many = verdicts(convoy(5, [*others[:2], *entries, *others[2:]], off), tmp_path / "many")
    for pair in OWN:
        assert many.get(pair) == few.get(pair), pair
    # Another rule for one link changes where its receiver drives, but not what others receive.
    ruled = [entries[0], entry(chance, OWN[1]), entries[2]]
    assert verdicts(convoy(3, ruled, {}), tmp_path / "ruled").get(OWN[0]) == few.get(OWN[0])
