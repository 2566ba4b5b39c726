"""Two runs of different settings never go by the same name."""

import json
import shutil
from pathlib import Path

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.results.log_summary import METADATA_NAME
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
        (["convoy.gap_m=3"], None),
        (["convoy.gap_m=4"], None),
        (["control.alpha_ratio=0.7"], None),
        (["links.loss_ratio=0.1"], None),
        ([], 2),
        (["convoy.gap_m=3"], 2),
    ]
    found = [load_scenario("lane_change", [SHORT, *more], seed) for more, seed in ways]
    assert len({scenario.title for scenario in found}) == len(ways)
    assert len({scenario.slug for scenario in found}) == len(ways)
    assert len({scenario.virtual_run_id for scenario in found}) == len(ways)


GILBERT = 'links.loss={kind="gilbert_elliott",loss_ratio=0.2,burst_messages_mean=8.0}'
RADIO = 'links.radio={kind="table",distance_m=[0.0,90.0],delivery_ratio=[0.9,0.8]}'
SILENCE = 'link=[{sender="lead",receiver="*",outages=[{kind="window",from_s=1.0,to_s=2.0}]}]'


@pytest.mark.parametrize(
    ("settings", "loss"),
    [
        ((), "loss 0 %"),
        (("links.loss_ratio=0.4",), "loss 40 %"),
        ((GILBERT,), "loss 20 %"),
        ((GILBERT, "links.loss_ratio=0.1"), "loss 28 %"),
        ((GILBERT, 'link=[{sender="v1",receiver="v2",loss_ratio=0.5}]'), "loss 20 to 60 %"),
        ((RADIO,), "loss by radio"),
        ((RADIO, "links.queue={bytes_per_s=900.0}"), "loss by radio and queue"),
        ((SILENCE, "links.loss_ratio=0.1"), "loss 10 %, loss by outages"),
        (("links.preset=nlosv_etsi",), "channel nlosv_etsi"),
        (("links.preset=bursty",), "loss 20 %, channel bursty"),
    ],
)
def test_the_title_has_the_loss_of_all_laws(settings: tuple[str, ...], loss: str) -> None:
    title = load_scenario("lane_change", [SHORT, *settings]).title
    assert title.startswith(f"lane_change, seed 1, α 0.5, {loss}, {SHORT}"), title


def test_files_of_one_name_are_distinguished(tmp_path: Path) -> None:
    """Also those that have taken the name of a shipped scenario."""
    files = []
    for place, gap in enumerate((3, 4)):
        files.append(tmp_path / str(place) / "lane_change.toml")
        files[-1].parent.mkdir()
        files[-1].write_text(f'extends = "lane_change"\nconvoy.gap_m = {gap}\n', encoding="utf-8")
    shipped, *mine = load_scenario("lane_change"), *map(load_scenario, files)
    assert len({scenario.name for scenario in (shipped, *mine)}) == 1
    for known_by in ("title", "virtual_run_id"):
        assert len({getattr(scenario, known_by) for scenario in (shipped, *mine)}) == 3
    assert mine[0].title.startswith(f"lane_change ({mine[0].fingerprint}), seed 1")
    again = load_scenario(Path(shutil.copy(files[0], tmp_path / "moved.toml")))
    assert again.title == mine[0].title  # by its content, not by its place
