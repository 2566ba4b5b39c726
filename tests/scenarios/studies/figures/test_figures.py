"""Standard figures: their plans, their points against known runs, and a small one."""

import csv
import json
import re
from collections.abc import Mapping
from math import exp, log
from pathlib import Path

import pytest
from click.testing import CliRunner
from scipy.stats import t

from scenarios.cli.main import cli
from scenarios.definition.errors import ScenarioError
from scenarios.studies.figures.cacc import LAWS
from scenarios.studies.figures.registry import FIGURE_STUDIES
from scenarios.studies.figures.study import FigureOptions, FigureStudy, collisions_in, point
from scenarios.studies.many.sweeps.cell_table import SweepTable, table_of
from scenarios.studies.many.sweeps.plan import run_key


def study_of(name: str, **options: object) -> FigureStudy:
    return FIGURE_STUDIES[name](FigureOptions(**options))  # type: ignore[arg-type]


def known_tables(study: FigureStudy, values: Mapping[str, float]) -> dict[str, SweepTable]:
    """Tables as if each run had these figures."""
    tables = {}
    for label, plan in study.sweeps.items():
        figures = [values.get(figure.name) for figure in plan.figures]
        seeds = range(1, plan.seeds + 1)
        keys = [run_key(cell, seed) for cell in range(len(plan.cells)) for seed in seeds]
        entry = {"outcome": "completed", "reason": "", "figures": figures, "broken": []}
        tables[label] = table_of(plan, dict.fromkeys(keys, entry))
    return tables


@pytest.mark.parametrize("name", FIGURE_STUDIES)
def test_a_figure_is_small_by_default_and_grows_with_its_options(name: str) -> None:
    study = study_of(name)
    assert study.runs <= 100
    assert study_of(name, seeds=10).runs > study.runs
    for plan, command in zip(study.sweeps.values(), study.commands, strict=True):
        assert command.startswith(f"convoy sweep {plan.base.name} ")
        assert f"--seeds {plan.seeds}" in command
        assert all(f"--figure={figure.name}" in command for figure in plan.figures)
    with pytest.raises(ScenarioError, match=r"--vary: given convoy\.vehicles, allowed"):
        study_of(name, vary=("convoy.vehicles=3,4",))
    with pytest.raises(ScenarioError, match=r"convoy\.vehicles: given 2"):
        study_of(name, sets=("convoy.vehicles=2",))


@pytest.mark.parametrize("name", FIGURE_STUDIES)
def test_series_with_collisions_are_named(name: str) -> None:
    study = study_of(name)
    assert not collisions_in(known_tables(study, {"events.collision": 0.0}))
    tables = known_tables(study, {"events.collision": 0.0})
    label, plan = next(iter(study.sweeps.items()))
    tables[label] = known_tables(study, {"events.collision": 2.0})[label]
    runs = len(plan.cells) * plan.seeds
    assert f"{label} ({runs} of {runs} runs)" in collisions_in(tables)


def test_settings_of_the_user_replace_those_of_the_figure() -> None:
    study = study_of("loss-over-gap", sets=("duration_s=3",), vary=("convoy.gap_m=4,5",))
    for plan in study.sweeps.values():
        durations = [text for text in plan.base.overrides if text.startswith("duration_s")]
        assert durations == ["duration_s=3"]
        assert plan.axes[0].numbers == (4.0, 5.0)


def test_the_laws_are_compared_by_two_gains() -> None:
    study = study_of("cacc", seeds=2, sets=("convoy.vehicles=6",), vary=("links.loss_ratio=0,0.5",))
    values = {
        "v3.string.spacing_error_m_rms": 0.5,
        "v6.string.spacing_error_m_rms": 1.0,
        "v6.string.acceleration_gain_l2_from_lead": 0.8,
    }
    points = study.points(known_tables(study, values))
    assert {one.series for one in points} == set(study.sweeps)
    assert len(points) == len(LAWS) * 2 * len(study.panels)
    for one in points:
        gain = 2.0 if "Spacing" in study.panels[one.panel].title else 0.8
        assert one.mean == pytest.approx(gain)
        assert one.count == one.runs == 2
    quiet = study.points(known_tables(study, values | {"v3.string.spacing_error_m_rms": 1e-4}))
    assert {one.count for one in quiet if one.panel < 2} == {0}


def test_the_outcome_names_no_law_without_a_gain_as_stable() -> None:
    study = study_of("cacc", seeds=2)
    unknown = study.outcome(study.points(known_tables(study, {})))
    assert not re.search(r"\(\d", unknown)
    assert all(label in unknown for label in study.sweeps)


def test_lines_of_laws_state_the_headway_that_they_drive() -> None:
    study = study_of("cacc", seeds=2, sets=("speed.gap.headway_s=1.0",))
    assert "Ploeg, 1 s" in study.sweeps
    assert not any("0.5 s" in label for label in study.sweeps)
    with pytest.raises(ScenarioError, match=r"control\.longitudinal"):
        study_of("cacc", sets=("control.longitudinal.use=acc",))


def test_an_axis_is_given_once() -> None:
    with pytest.raises(ScenarioError, match="twice"):
        study_of("cacc", vary=("gnss.rate_hz=4", "gnss.rate_hz=10"))


def test_errors_along_the_string_are_in_centimetres() -> None:
    study = study_of("error-along-string", seeds=2, sets=("convoy.vehicles=4",))
    values = {f"v{n}.string.lateral_error_m_rms": 0.01 * n for n in (2, 3, 4)}
    points = [one for one in study.points(known_tables(study, values)) if one.panel == 0]
    assert {one.x for one in points} == {2, 3, 4}
    assert [one.mean for one in points] == pytest.approx([one.x for one in points])
    assert "2.0 behind predecessor" in study.outcome(points)


def test_the_interval_of_a_point_is_students() -> None:
    gains = [0.5, 1.0, 4.0]
    found = point(0, "a", 1.0, [*gains, None], is_log=True)
    logs = [log(gain) for gain in gains]
    middle = sum(logs) / 3.0
    spread = (sum((one - middle) ** 2 for one in logs) / 2.0 / 3.0) ** 0.5
    half = float(t.ppf(0.975, 2)) * spread
    assert (found.mean, found.low, found.high) == pytest.approx(
        (exp(middle), exp(middle - half), exp(middle + half))
    )
    assert (found.count, found.runs) == (3, 4)
    assert point(0, "a", 1.0, [None, 2.0]).low is None


def test_a_small_figure_writes_what_it_prints(tmp_path: Path) -> None:
    out = tmp_path / "small"
    vary = ("--vary=convoy.gap_m=5", "--vary=links.loss_ratio=0", "--vary=links.latency_ms=20")
    arguments = ["figure", "loss-over-gap", *vary, "--seeds=2", "--duration=0.3", "--workers=0"]
    done = CliRunner().invoke(cli, [*arguments, f"--out={out}"])
    assert done.exit_code == 0, done.output
    with (out / "loss-over-gap.csv").open() as file:
        rows = list(csv.DictReader(file))
    whole = json.loads((out / "loss-over-gap.json").read_text())
    assert len(rows) == len(whole["points"]) == 2
    assert [float(row["mean"]) for row in rows] == [row["mean"] for row in whole["points"]]
    assert whole["outcome"] in done.output
    for command in whole["commands"]:
        assert command in done.output
    assert (out / "loss-over-gap.png").read_bytes().startswith(b"\x89PNG")
