"""Offset in bends that the paper's law leaves with a learned load: predicted and driven."""

import re

import numpy as np
import pytest

from scenarios.definition.check.findings import check, report_of
from scenarios.definition.scenario import scenario_from_text
from scenarios.studies.paper.drives import drive_trial

LEARNED = "control.estimate_slip=true"
BEND = """
extends = "paper_base"
name = "bend"
[path]
kind = "segments"
segments = [{ length_m = 100.0 }, { length_m = 600.0, radius_m = 500.0, turn = "left" }]
[convoy]
vehicles = 2
"""


@pytest.mark.spread(2)
@pytest.mark.parametrize("speed", [8.0, 15.0, 27.0, 30.0])
def test_a_car_settles_where_the_warning_predicts(speed: float) -> None:
    settings = [LEARNED, f"speed.set_mps={speed}", f"duration_s={600.0 / speed}"]
    scenario = scenario_from_text(BEND, overrides=settings)
    (line,) = [line for line in report_of(scenario).warnings if "estimate_slip" in line]
    predicted = re.search(r"settles (\d\.\d) cm beside", line)
    assert predicted is not None
    follower = drive_trial(scenario).followers[0]
    settled = 100.0 * float(np.abs(follower.cross_track[-50:]).mean())
    assert settled == pytest.approx(float(predicted[1]), abs=0.1)


def test_only_that_law_with_a_learned_load_gets_the_warning() -> None:
    (line,) = check("paper_base", [LEARNED]).warnings
    assert line.startswith("v2, v3, v4: ")
    assert check("paper_base").warnings == ()
    assert check("paper_base", [LEARNED, "control.controller=slip_compensated"]).warnings == ()
