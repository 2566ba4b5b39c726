"""`convoy.compare` and `run.report` return what the commands print and write."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

import scenarios.api as convoy
from scenarios.cli.main import cli


def command(*arguments: object) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[convoy.Run, convoy.Run]:
    folder = tmp_path_factory.mktemp("pair")
    settings = {"duration_s": 3.0, "convoy.vehicles": 3}
    offset = {"vehicle.v2.lateral_offset_m": 0.5, "links.latency_ms": 20.0, "links.loss_ratio": 0.0}
    offset |= {"convoy.gap_m": 10.0, "speed.set_mps": 30.0, "limits.true_gap_m_min": 1.0}
    return (
        convoy.run(set=settings, out=folder / "a"),
        convoy.run(set=settings | offset, out=folder / "b"),
    )


def test_a_comparison_has_the_rows_of_the_command(pair: tuple[convoy.Run, convoy.Run]) -> None:
    a, b = pair
    compared = convoy.compare(a, b.log.parent)
    printed = json.loads(command("compare", a.log, b.log, "--json").stdout)
    assert (compared.is_equal, compared.sentence) == (printed["equal"], printed["sentence"])
    assert compared.sentence in compared._repr_html_()
    assert compared.settings.key.tolist() == list(printed["settings"])
    assert "vehicle.v2.lateral_offset_m" in compared.settings.key
    assert compared.metrics.name.tolist() == [row["name"] for row in printed["metrics"]]
    rows = compared.positions
    assert rows.vehicle.tolist() == ["v1", "v2", "v3"]
    assert rows.difference_m_max.tolist() == [r["difference_m_max"] for r in printed["positions"]]
    assert rows.difference_m_max[1] == pytest.approx(0.5, abs=0.02)
    assert np.isnan(rows.parts_at_m[0])
    assert "A: lane_change" in compared.runs["A"].title
    figure = compared.plot(["v2"])
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    assert max(one.get_window_extent().x1 for one in figure.legends) <= figure.bbox.x1
    same = convoy.compare(a, a)
    assert same.is_equal
    assert "equal" in repr(same)
    assert len(same.settings) == len(same.metrics) == 0
    with pytest.raises(convoy.Error, match="allowed 2 to 8"):
        convoy.compare(a)


def test_a_report_is_that_of_the_command(
    pair: tuple[convoy.Run, convoy.Run], tmp_path: Path
) -> None:
    run = pair[1]
    page = run.report(tmp_path / "here.html")
    assert command("report", run.log, "--html", tmp_path / "there.html").exit_code == 0
    assert page.read_bytes() == (tmp_path / "there.html").read_bytes()


def test_errors_along_the_string_are_those_of_the_summary(
    pair: tuple[convoy.Run, convoy.Run],
) -> None:
    run = pair[1]
    _, *followers = run.summary.vehicles
    rows = run.string_errors
    assert rows.vehicle.tolist() == ["v2", "v3"]
    assert rows.number.tolist() == [2, 3]
    assert rows.error_m_max.tolist() == [one.cross_track_error_m_max for one in followers]
    assert rows.error_m_rms.tolist() == [one.cross_track_error_m_rms for one in followers]
    assert rows.lateral_error_m_rms.tolist() == [
        one.string.lateral_error_m_rms for one in followers
    ]
