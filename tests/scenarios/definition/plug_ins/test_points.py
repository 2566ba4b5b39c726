"""Classes and functions that a scenario selects: parameters, results, and planted mistakes."""

import importlib
import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from scenarios.cli.main import cli
from scenarios.definition.channel.build import link_effects
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario, scenario_from_text
from scenarios.definition.schema.plug_ins import table
from scenarios.definition.schema.plug_ins.point import PlugInPoint
from scenarios.definition.schema.plug_ins.points import POINTS
from scenarios.results.summary import RunSummary, from_json
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.scenarios.plug_ins import CODE, SETTINGS
from transport.links.laws.link_law import TransmissionContext
from transport.links.link import Link
from transport.texts import ConvoyError
from vehicles.driver.tracking import TrackingErrors

TWO = ["convoy.vehicles=2", "duration_s=1"]
Module = Callable[[str], str]


def virtual(folder: Path, *sets: str) -> RunSummary:
    return run_virtual(load_scenario("lane_change", sets), folder, Stop())


@pytest.mark.parametrize("point", POINTS, ids=lambda point: point.key)
def test_a_class_or_function_at_each_point_runs_and_its_parameter_counts(
    point: PlugInPoint, module: Module, tmp_path: Path
) -> None:
    """The stored scenario is the same, and the module is part of the run's identity."""
    name = module(CODE)
    # 18 m is the gap that [speed.gap] requests: far below it, all laws brake at the limit.
    gap = ["convoy.gap_m=18"] if point.key == "control.longitudinal" else []
    toml = SETTINGS[point.key].replace("mine.", f"{name}.")
    head = 'extends = "lane_change"\nname = "own"\nduration_s = 1.0\n'
    scenario = scenario_from_text(f"{head}{toml}", overrides=["convoy.vehicles=3", *gap])
    assert [one.partition(".")[0] for one in scenario.plug_ins] == [name]
    again = scenario_from_text(scenario.text)
    assert (again.text, again.plug_ins) == (scenario.text, scenario.plug_ins)
    summary = run_virtual(scenario, tmp_path / "own", Stop())
    assert summary.outcome == "completed", summary.reason
    assert list(summary.identity.plug_ins) == [name]
    overrides = ["convoy.vehicles=3", "duration_s=1", *gap]
    overrides += ["speed.followers=gap"] if gap else []
    usual = virtual(tmp_path / "usual", *overrides)
    assert (summary.vehicles, summary.events) != (usual.vehicles, usual.events)


REFUSED = """
from pydantic import Field
from typing import Annotated
from transport.links.laws.burst_losses import BaseLoss

class Law:
    def __init__(self, parameters, gains, share: Annotated[float, Field(le=1)] = 1.0):
        pass
    def steer(self, errors, speed):
        pass

class Mute:
    pass

def function(run, share=1.0):
    return 1.0

class Half(BaseLoss):
    ratio: float
class Raises(BaseLoss):
    def model_post_init(self, context):
        raise RuntimeError("early")
"""
REFUSALS = {
    "control.controller=nobody.Law": "control.controller: No module named 'nobody', neither in the",
    "control.controller=M.Nobody": "control.controller: expected a class with the methods steer(er",
    "control.controller=M.function": "control.controller: function is not a class with the methods",
    "control.controller=M.Mute": "control.controller: a class with the methods steer(errors, speed",
    "control.controller={use='M.Law',shares=1}": "control.controller.shares: unknown key, did you",
    "control.controller={use='M.Law',share='a'}": 'control.controller.share: given "a", allowed a',
    "control.controller={use='M.Law',share=nan}": "control.controller.share: given nan, allowed a",
    "control.controller={use='M.Law',share=2.0}": "control.controller.share: given 2.0, allowed at",
    "control.controller={use='stanley',share=1.0}": "control.controller.share: unknown key",
    "control.controller=stanly": 'control.controller: given "stanly", allowed "slip_compensated"',
    "event=['M.Law']": "event[0]: Law is not a function (run)",
    "figure=[{use='M.function',more=1}]": "figure[0].more: unknown key",
    "figure=['M.function','M.function']": "figure[1]: given function twice",
    "links.loss={use='M.Half'}": "links.loss.ratio: missing",
    "links.loss={use='M.Raises'}": "links.loss: invalid parameters: RuntimeError: early",
    "links.delay=M.Half": "links.delay: a class with the base transport.links.laws.delays",
    "gnss.errors=[{use='M.None'}]": "gnss.errors[0]: is not in M; expected a class with the base",
    "control.longitudinal=acc": 'control.longitudinal: given acc, but speed.followers = "same"',
}


@pytest.mark.parametrize("setting", REFUSALS)
def test_a_selection_that_does_not_fit_is_one_line(setting: str, module: Module) -> None:
    name = module(REFUSED)
    with pytest.raises(ScenarioError) as refused:
        load_scenario("lane_change", [re.sub(r"(?<=[='\"])M\.", f"{name}.", setting)])
    (line,) = refused.value.lines
    key, *words = REFUSALS[setting].replace("M;", f"{name};").split(": ")
    assert key in line
    assert all(one in line for one in words)


@pytest.mark.parametrize("law", ["acc", "ploeg"])
def test_a_law_with_a_time_gap_refuses_a_headway_of_zero(law: str) -> None:
    gap = ["speed.followers=gap", "speed.gap.headway_s=0"]
    with pytest.raises(ScenarioError, match="headway_s"):
        load_scenario("highway", [*gap, f"control.longitudinal={law}"])


def test_a_module_that_cannot_be_imported_is_named_with_its_line(module: Module) -> None:
    for code in ("import os\n1 / 0", "import os\nclass :"):
        name = module(code)
        with pytest.raises(ScenarioError, match=rf"\({name}\.py, line 2\)"):
            load_scenario("lane_change", [f"control.controller={name}.Law"])


FAULTY = """
import math
from transport.links.laws.delays import BaseDelay
from transport.links.laws.burst_losses import BaseLoss
from vehicles.car.gnss_error_terms import ErrorTerm
from vehicles.car.sending_rules import SendingRule
from vehicles.driver.reactions import Extrapolate
from vehicles.driver.steering import FeedforwardFeedback, SteeringCommand
from dataclasses import dataclass

class Floats(FeedforwardFeedback):
    def steer(self, errors, speed):
        return 0.0
class Nan(FeedforwardFeedback):
    def steer(self, errors, speed):
        return SteeringCommand(math.nan, 0.0, 0.0)
class Raises(FeedforwardFeedback):
    def steer(self, errors, speed):
        raise RuntimeError("of two\\nlines")
class Unbuilt(FeedforwardFeedback):
    def __init__(self, parameters, gains):
        math.sqrt(-1.0)
class Undecided:
    def __init__(self, setup):
        pass
    def acceleration(self, speed, ahead):
        return None
class Bare:
    def fuse(self, sources, settings):
        return 1.0
class Brakes(Extrapolate):
    def acceleration(self, situation, mode, speed, wanted):
        return float("-inf")
class Wordy(BaseLoss):
    def judge(self, draw, context):
        return "swallowed"
class Late(BaseDelay):
    def judge(self, draw, context):
        return 1 // (10 - context.seq) or 0
@dataclass(frozen=True, kw_only=True)
class Truthy(SendingRule):
    def begin(self, context):
        return self
    def due(self, now, unsent, allowed_from):
        return 1
@dataclass(frozen=True)
class Flat(ErrorTerm):
    variance: float = 0.0
    def begin(self, context):
        return self
    def at(self, body, now):
        return 0.1
"""
FAULTS = {
    "control.controller='F.Floats'": ("steer() returned 0.0, expected a SteeringCommand", 12),
    "control.controller='F.Nan'": ("steer() returned SteeringCommand(steering=nan", 15),
    "control.controller='F.Raises'": ("steer() raised RuntimeError: of two lines", 19),
    "control.controller='F.Unbuilt'": ("ValueError: ", 22),
    "control.longitudinal='F.Undecided'": ("acceleration() returned None, expected a finite", 26),
    "control.fusion='F.Bare'": ("fuse() returned 1.0, expected a list", 29),
    "control.degradation.reaction='F.Brakes'": ("acceleration() returned -inf", 32),
    "links.loss='F.Wordy'": ("judge() returned 'swallowed'", 35),
    "links.delay='F.Late'": ("judge() raised ZeroDivisionError", 39),
    "vehicle.v2.sending={use='F.Truthy'}": ("due() returned 1, expected True or False", 44),
    "gnss.errors=[{use='F.Flat'}]": ("at() returned 0.1, expected a tuple", 51),
}


@pytest.mark.parametrize("setting", FAULTS)
def test_a_fault_ends_the_run_with_vehicle_instant_file_and_line(
    setting: str, module: Module, tmp_path: Path
) -> None:
    name, (text, line) = module(FAULTY), FAULTS[setting]
    sets = ["convoy.vehicles=3", "duration_s=1", re.sub(r"'F\.", f"'{name}.", setting)]
    sets += ["speed.followers=gap"] if "longitudinal" in setting else []
    if "Unbuilt" in setting:
        with pytest.raises(ConvoyError) as failed:
            virtual(tmp_path, *sets)
        reason = str(failed.value)
    else:
        summary = virtual(tmp_path, *sets)
        assert summary.outcome == "failed"
        reason = summary.reason
        assert re.match(r"v[123]: .* s after the start$", reason), reason
    assert text in reason
    where = re.search(rf"\({name}\.py, line (\d+)\)", reason)
    assert where
    assert abs(int(where[1]) - line) <= 1


def test_parameters_reach_the_class_also_by_vehicle(module: Module) -> None:
    name = module(CODE)
    own = f"vehicle.v2.control.controller={{use='{name}.PurePursuit',lookahead_s=4.0}}"
    scenario = load_scenario("lane_change", [f"control.controller.use={name}.PurePursuit", own])
    errors = TrackingErrors(lateral=0.0, heading=0.1, yaw_rate=0.0, curvature=0.0)
    first, second = (scenario.vehicle(one).controller().steer(errors, 9.0) for one in ("v1", "v2"))
    assert second.steering == pytest.approx(0.2 * first.steering)
    assert first.steering != 0.0


def test_a_model_of_ones_own_equals_the_shipped_one(module: Module) -> None:
    """Of a loss with the purpose and the ratio of `loss_ratio`, each verdict is the same."""
    name = module(
        "from transport.links.laws.burst_losses import BaseLoss\n"
        "class Half(BaseLoss):\n"
        "    ratio: float\n"
        "    def judge(self, draw, context):\n"
        "        return 'loss' if draw('loss', context.seq) < self.ratio else 0\n"
    )
    own = load_scenario("lane_change", [f"links.loss={{use='{name}.Half',ratio=0.4}}"])
    shipped = load_scenario("lane_change", ["links.loss_ratio=0.4"])
    verdicts = []
    for scenario in (own, shipped):
        link = Link(link_effects(scenario.links["v1", "v2"], 20.0), 1, "v1", "v2")
        verdicts.append([link.judge(TransmissionContext(seq, seq * 10**8)) for seq in range(200)])
    assert verdicts[0] == verdicts[1]
    assert 0.3 < sum(one.outcome == "dropped" for one in verdicts[0]) / 200 < 0.5


def test_a_log_is_readable_without_the_modules_of_its_classes(
    module: Module, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = module(CODE)
    own = [line.replace("mine.", f"{name}.") for key, line in SETTINGS.items() if "gnss" not in key]
    lines = "\n".join(line for line in own if "sending" not in line)
    text = f'extends = "lane_change"\nname = "own"\n{lines}'
    run_virtual(scenario_from_text(text, overrides=TWO), tmp_path / "run", Stop())
    monkeypatch.delitem(sys.modules, name)
    (tmp_path / f"{name}.py").unlink()
    monkeypatch.setattr(table, "_TABLES", {})
    importlib.invalidate_caches()
    assert from_json((tmp_path / "run" / "summary.json").read_text()).links[0].judged == 20
    ran = CliRunner().invoke(cli, ["explain", str(tmp_path / "run"), "--vehicle=v2", "--at=0.9"])
    assert ran.exit_code == 0, ran.output


MEASURES = """
def every(run):
    for name in run.names:
        yield from run.spans(name, run.table(name, "truth")["seq"] % 2 == 0)
def distance(run):
    return {name: run.table(name, "truth")["distance_m"][-1] for name in run.names}
def whole(run):
    return run.table("v1", "truth")["seq"][7] - run.table("v1", "truth")["seq"][0]
def faulty(run):
    return {"v1": float("inf")}
def foreign(run):
    return {"v9": 1.0}
def stranger(run):
    yield "v9", 0, 1
def broken(run):
    yield 1 / 0
"""


def test_own_events_and_metrics_are_in_the_summary(module: Module, tmp_path: Path) -> None:
    name = module(MEASURES)
    own = [f"event=['{name}.every']", f"figure=['{name}.distance','{name}.whole']"]
    summary = virtual(tmp_path, *TWO, *own)
    assert [row.own_figures for row in summary.vehicles] == [
        {"distance": row.distance_m, "whole": 7} for row in summary.vehicles
    ]
    assert {(one.name, *one.vehicles) for one in summary.events} == {
        ("every", "v1"),
        ("every", "v2"),
    }
    assert from_json((tmp_path / "summary.json").read_text()).events == summary.events
    assert summary.outcome_line.endswith(", 2 own events")


def test_a_function_that_fails_is_left_out_with_a_warning(module: Module, tmp_path: Path) -> None:
    name = module(MEASURES)
    own = [
        f"event=['{name}.stranger','{name}.broken']",
        f"figure=['{name}.faulty','{name}.foreign']",
    ]
    summary = virtual(tmp_path, *TWO, *own)
    assert summary.outcome == "completed"
    assert [line.split("'")[1] for line in summary.warnings] == [
        f"{name}.{one}" for one in ("faulty", "foreign", "stranger", "broken")
    ]
