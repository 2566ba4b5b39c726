"""`convoy reproduce` on small cases and on made-up findings."""

import json
import re
from functools import partial
from math import isfinite
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.results.files import LOG_NAME
from scenarios.studies.job import Job
from scenarios.studies.paper import reproduce as reproduction
from scenarios.studies.paper.claim import JUDGEMENTS
from scenarios.studies.paper.experiments import (
    BASE,
    RUNS_OF_CASE,
    TRAJECTORIES,
    VARIABLE_SPEED,
    Experiment,
    Part,
    WithTrajectory,
)
from scenarios.studies.paper.report import CLAIMS, all_pictures, write_report
from scenarios.studies.paper.reproduce import chosen_cases, jobs_of, reproduce, run_experiment
from tests.made.many.engines import engine_here
from tests.scenarios.studies.paper.findings import (
    along_both_trajectories,
    findings_with_all_claims_true,
)

PNG = b"\x89PNG"

NAMES = """
    parameters steering_parameters feedforward preview signs preview_samples one_change
    ten_centimetres circle recipe_suffices two_samples
    polynomial state_equation proposition_1_square_integrable
    proposition_1_in_the_mean proposition_1 norm_of_g equivalence stabilising_set
    inside_the_intersection ball first_condition inertia not_affine all_loadings open_loop_roots
    road base_below_9_cm base_where
    base_decreasing base_true amplified_without_lead_data reduced_by_lead_data a_decreasing
    b_decreasing c_decreasing d_decreasing uneven faster mass small variable_below_11_cm
    slightly_more variable_speed_decreasing definition_1 bounded_along_the_convoy
    others_true amplified_in_l2 not_amplified_in_l2 propagation_measured
    field_course field_amplified field_not_amplified field_initial_error
    field_on_the_road against_stanley against_pure_pursuit alpha_chain
    noise_along_the_convoy preview_suffices loss_varied latency_varied
"""
"""Names of the claims in report.json, in the order of the paper."""


def no_progress(_: str) -> None:
    pass


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("whole")
    findings = findings_with_all_claims_true()
    for case in RUNS_OF_CASE.values():
        for key in case:
            findings.trials.setdefault(key, findings.trials[BASE])
    write_report(along_both_trajectories(findings), list(RUNS_OF_CASE), out)
    return out


def numbers_in(value: Any) -> list[float]:
    if isinstance(value, dict):
        return [number for entry in value.values() for number in numbers_in(entry)]
    if isinstance(value, list):
        return [number for entry in value for number in numbers_in(entry)]
    return [value] if isinstance(value, float) else []


def test_a_whole_report_has_a_row_for_each_claim_and_every_picture(whole: Path) -> None:
    text = (whole / "report.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| .*\|$", text, flags=re.MULTILINE)
    for claim in CLAIMS:
        paper = claim.paper.replace("|", "\\|")
        assert sum(f"| {paper} |" in row for row in rows) >= 1, claim.name
    assert set(re.findall(r"!\[.*?\]\((.*?)\)", text)) == set(all_pictures())
    for name in all_pictures():
        assert (whole / name).read_bytes().startswith(PNG)


def test_report_json_agrees_with_report_md(whole: Path) -> None:
    report = json.loads((whole / "report.json").read_text(encoding="utf-8"))
    assert [claim["name"] for claim in report["claims"]] == [c.name for c in CLAIMS]
    assert [claim["name"] for claim in report["claims"]] == NAMES.split()
    text = (whole / "report.md").read_text(encoding="utf-8")
    for kind in ("fitted", "paper"):
        rows = {claim["name"]: claim["trajectories"][kind] for claim in report["claims"]}
        counts = [sum(row["verdict"] == j for row in rows.values()) for j in JUDGEMENTS]
        assert sum(counts) == len(CLAIMS)
        assert counts[2] == 5
        line = (
            f"{counts[0]} hold, {counts[1]} undecided, 5 harmless misprints, {counts[3]} do not "
            f"hold, {counts[4]} cannot be checked"
        )
        assert line in text
        runs = report["runs"][kind]
        assert set(runs) == {"field/with", "field/without"} | {
            str(key) for case in RUNS_OF_CASE.values() for key in case
        }
        assert rows["a_decreasing"]["noise"] == {"holding": 2, "runs": 2, "kind": "seeds"}
        assert runs["base"]["tracking_error_m_max"] == pytest.approx([0.08, 0.06, 0.05])
    assert all(map(isfinite, numbers_in(report)))


def test_a_small_reproduction_from_end_to_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny = {BASE: Experiment(overrides=("duration_s=26.0", "convoy.vehicles=2"), logged=True)}
    monkeypatch.setitem(RUNS_OF_CASE, "base", tiny)
    progress: list[str] = []
    assert reproduce(["base"], tmp_path / "paper", progress.append, workers=0) == 0
    for kind in ("fitted", "paper"):
        assert (tmp_path / "paper" / kind / "base" / LOG_NAME).exists()
    report = json.loads((tmp_path / "paper" / "report.json").read_text(encoding="utf-8"))
    claims = {claim["name"]: claim["trajectories"] for claim in report["claims"]}
    assert {row["verdict"] for row in claims["base_below_9_cm"].values()} == {"holds"}
    errors = [report["runs"][kind]["base"]["tracking_error_m_max"] for kind in ("fitted", "paper")]
    assert errors[0] < errors[1]
    assert "base_true" not in claims  # it needs runs of other cases
    assert report["logs"] == ["fitted/base/run.mcap", "paper/base/run.mcap"]
    assert any("2 of 2 runs" in line for line in progress)
    assert "report.md" in progress[-1]


def test_a_report_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "report.md").write_text("mine")
    with pytest.raises(ScenarioError, match="exists"):
        reproduce(["base"], tmp_path, no_progress)
    assert (tmp_path / "report.md").read_text() == "mine"


def test_every_run_is_one_job_and_long_jobs_come_first(tmp_path: Path) -> None:
    jobs = list(jobs_of(chosen_cases([]), tmp_path))
    runs = {key: run for case in RUNS_OF_CASE.values() for key, run in case.items()}
    alone = {key for key, run in runs.items() if run.names_trajectory}
    assert alone == {BASE.with_variant("paper_prefix")}
    repeated = {WithTrajectory(kind, key) for key in runs.keys() - alone for kind in TRAJECTORIES}
    assert repeated | alone <= set(jobs)
    assert not {WithTrajectory(kind, key) for key in alone for kind in TRAJECTORIES} & set(jobs)
    assert jobs[:3] == [*(WithTrajectory(kind, Part.FIELD) for kind in TRAJECTORIES), Part.GAINS]
    assert jobs.index(WithTrajectory("paper", VARIABLE_SPEED)) < jobs.index(
        WithTrajectory("fitted", BASE.noisy(1))
    )


def test_a_failed_job_ends_the_reproduction(tmp_path: Path) -> None:
    work = partial(run_experiment, Experiment(scenario="no_such"), tmp_path)
    with engine_here() as engine, pytest.raises(ScenarioError, match="no such file"):
        engine.results([Job(key="bad", work=work)])


def test_the_gains_pictures_are_those_of_the_gains_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Path] = []

    def report(*_: object, out_dir: Path, picture_format: str) -> SimpleNamespace:
        drawn.append(out_dir)
        return SimpleNamespace(pictures=(f"roots_over_loadings.{picture_format}",))

    monkeypatch.setattr("scenarios.studies.gains.report.gains_report", report)
    pictures = reproduction.jobs_of(["gains"], tmp_path)[Part.GAINS]()
    assert pictures == ("roots_over_loadings.png",)
    assert drawn == [tmp_path / "gains"]


def test_an_unknown_case_is_refused_with_a_hint(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"no such case, did you mean radius\?, allowed base"):
        reproduce(["radios"], tmp_path / "new", no_progress)
    assert not (tmp_path / "new").exists()


def test_cases_come_in_the_order_of_the_paper_and_none_means_all() -> None:
    assert chosen_cases(["field", "a", "base"]) == ["base", "a", "field"]
    assert chosen_cases([]) == list(RUNS_OF_CASE)
