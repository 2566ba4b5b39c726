"""`convoy bisect` on a small convoy: files, figures, refusals."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from scenarios import api
from scenarios.cli.main import cli
from scenarios.definition.overrides import parse_override
from tests.made.many.small_convoy import SETTINGS

SMALL = [f"--set={one}" for one in SETTINGS]
NAME = "lossy_lane_change"


def convoy(*words: str) -> Result:
    return CliRunner().invoke(cli, list(words))


def settings() -> dict[str, object]:
    parsed = map(parse_override, SETTINGS)
    return {".".join(keys): value for keys, value in parsed}


def test_a_boundary_is_estimated_and_written(tmp_path: Path) -> None:
    options = ["--limit=v2.error_m=1", "--precision=0.1", "--workers=0", f"--out={tmp_path}"]
    done = convoy("bisect", NAME, "links.loss_ratio", *options, *SMALL)
    assert done.exit_code == 0, done.output
    result = json.loads((tmp_path / "bisect.json").read_text())
    assert (result["schema"], result["limit"]) == ("convoy.bisect/2", "v2.error_m=1")
    assert (tmp_path / "boundary.png").stat().st_size > 10_000
    assert 0.0 < result["low"] < result["boundary"] < result["high"] < result["low"] + 0.2
    assert result["runs"] == sum(one["runs"] for one in result["points"]) >= 40
    assert f"links.loss_ratio = {result['boundary']:.4g}, 95 % interval" in done.output
    assert "at least 50 % of the runs break v2.error_m=1" in done.output
    again = convoy("bisect", NAME, "links.loss_ratio", *options, *SMALL)
    assert again.exit_code == 2
    assert "exists; give another folder by --out" in again.output


def test_a_limit_that_is_held_everywhere_fails_at_once(tmp_path: Path) -> None:
    options = ["--limit=error_m=90", "--workers=0", f"--out={tmp_path}"]
    done = convoy("bisect", NAME, "links.loss_ratio", *options, *SMALL)
    assert done.exit_code == 1, done.output
    assert "fewer than 50 % of the runs break error_m=90, everywhere from 0 to 1" in done.output
    result = json.loads((tmp_path / "bisect.json").read_text())
    assert result["finding"] == "held"
    same = api.bisect(NAME, "links.loss_ratio", "error_m=90", set=settings(), workers=0)
    assert (same.finding, same.runs) == ("held", result["runs"])


LOSS = ["bisect", NAME, "links.loss_ratio"]
REFUSED = {
    "no number": (["bisect", NAME, "control.controller"], "control.controller: given "),
    "the seed": (["bisect", NAME, "seed"], "seed: given "),
    "an unknown key": (["bisect", NAME, "links.los_ratio"], "links.los_ratio"),
    "a whole number": (
        ["bisect", NAME, "convoy.vehicles", "--range=2:5"],
        "convoy.vehicles: takes whole numbers; use `convoy sweep",
    ),
    "a missing entry": (
        ["bisect", NAME, "change.0.at_s"],
        "change.0.at_s: given index 0 of change, which has no entries",
    ),
    "a share that is none": (
        [*LOSS, "--share=nan"], "nan is not a finite number",
    ),
    "a width that is none": ([*LOSS, "--precision=nan"], "nan is not a finite number"),
    "a limit below nothing": ([*LOSS, "--limit=error_m=-1"], "given 'error_m=-1', allowed"),
    "a limit of nothing": ([*LOSS, "--limit=gap_m=nan"], "given 'gap_m=nan', allowed"),
    "a limit without end": ([*LOSS, "--limit=error_m=inf"], "given 'error_m=inf', allowed"),
    "a range": ([*LOSS, "--range=1:0"], "LOW below HIGH"),
    "half a range": ([*LOSS, "--range=1"], "allowed LOW:HIGH"),
    "a width": ([*LOSS, "--precision=0.6"], "a quarter of the range"),
    "beyond the key": ([*LOSS, "--range=0:2"], "links.loss_ratio"),
    "a limit": ([*LOSS, "--limit=road"], "--limit: given 'road'"),
    "too few runs for a share": (
        [*LOSS, "--share=0.05", "--runs=399"],
        "--runs: given 399, allowed at least 400 for a share of 0.05",
    ),
    "a limit of no vehicle": (
        [*LOSS, "--limit=v9.error_m=1"], "no such vehicle",
    ),
    "a limit of the lead": ([*LOSS, "--limit=v1.error_m=1"], "v1 is the lead"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_are_one_line(case: str, tmp_path: Path) -> None:
    words, fact = REFUSED[case]
    done = convoy(*words, f"--out={tmp_path}")
    assert done.exit_code == 2
    assert fact in done.output
    assert "Traceback" not in done.output
    assert not list(tmp_path.iterdir())
