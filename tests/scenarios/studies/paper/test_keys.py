"""Text of keys: folder names, keys in report.json, progress lines."""

import pytest

from scenarios.studies.paper.experiments import (
    BASE,
    FIELD_WITHOUT,
    LONG_WITH,
    NO_LEAD_DATA,
    RUNS_OF_CASE,
    A,
    JobKey,
    Part,
    RunKey,
    SineKey,
    WithTrajectory,
    at_radius,
)


@pytest.mark.parametrize(
    ("key", "text"),
    [
        (BASE, "base"),
        (A.with_variant("same_times"), "a/same_times"),
        (BASE.noisy(1), "base/noise/1"),
        (BASE.moved(0.25), "base/phase/0.25"),
        (BASE.moved(0.5), "base/phase/0.5"),
        (NO_LEAD_DATA.noisy(5), "no_lead_data/noise/5"),
        (LONG_WITH, "long/with"),
        (at_radius(300.0), "radius/300"),
        (at_radius(1000.0).with_variant("no_lead_data"), "radius/1000/no_lead_data"),
        (at_radius(200.0).noisy(2), "radius/200/noise/2"),
        (FIELD_WITHOUT.noisy(3), "field/without/noise/3"),
        (WithTrajectory("paper", at_radius(200.0).noisy(2)), "paper/radius/200/noise/2"),
        (WithTrajectory("fitted", Part.FIELD), "fitted/field"),
        (Part.GAINS, "gains"),
        (SineKey(0.8, 0.25), "propagation at 0.8 rad/s, preview 0.25 s"),
        (SineKey(10.0, 0.8), "propagation at 10 rad/s, preview 0.8 s"),
    ],
)
def test_text(key: JobKey | RunKey | SineKey, text: str) -> None:
    assert str(key) == text
    assert f"{key}" == text


def test_no_two_runs_share_a_text() -> None:
    keys = {key for case in RUNS_OF_CASE.values() for key in case}
    assert len({str(key) for key in keys}) == len(keys)


def test_the_exact_run_of_a_repetition() -> None:
    key = at_radius(400.0).with_variant("slip_compensated")
    assert key.noisy(2).exact == key.moved(0.5).exact == key.exact == key
    assert key.noisy(2) != key
