"""Two runs of different settings never go by the same name."""

import json
from pathlib import Path

from scenarios.definition.scenario import load_scenario
from scenarios.results.log_summary import LOG_NAME, METADATA_NAME, SUMMARY_NAME
from scenarios.results.summary import RunIdentity, from_json
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from transport.log.reader import LogReader

SHORT = "duration_s=0.2"


def test_title_and_overrides_are_in_summary_and_log(tmp_path: Path) -> None:
    settings = [SHORT, 'convoy.names=["a","b"]']
    scenario = load_scenario("lane_change", settings, seed=9)
    run_virtual(scenario, tmp_path, Stop())
    text = (tmp_path / SUMMARY_NAME).read_text(encoding="utf-8")
    assert json.loads(text)["overrides"] == [*settings, "seed=9"]
    assert json.loads(text)["title"] == scenario.title
    assert from_json(text).identity.overrides == (*settings, "seed=9")
    metadata = LogReader(tmp_path / LOG_NAME).metadata()[METADATA_NAME]
    assert RunIdentity.of_values(metadata) == from_json(text).identity


def test_other_settings_give_another_title_and_slug() -> None:
    ways = [
        ([], None),
        (["convoy.gap_m=8"], None),
        (["convoy.gap_m=9"], None),
        (["control.alpha_ratio=0.7"], None),
        (["links.loss_ratio=0.1"], None),
        ([], 2),
        (["convoy.gap_m=8"], 2),
    ]
    found = [load_scenario("lane_change", [SHORT, *more], seed) for more, seed in ways]
    assert len({scenario.title for scenario in found}) == len(ways)
    assert len({scenario.slug for scenario in found}) == len(ways)
