"""Classes that a scenario selects: the printed examples, parameters, and planted mistakes."""

import importlib
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from click.testing import CliRunner

from scenarios.cli.main import cli
from scenarios.cli.plug_in_page import EXAMPLES
from scenarios.definition.channel.build import link_effects
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from scenarios.definition.schema.plug_ins import table
from scenarios.results.summary import from_json
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from transport.links.laws.link_law import TransmissionContext
from transport.links.link import Link
from vehicles.driver.tracking import TrackingErrors

TWO = ["convoy.vehicles=2", "duration_s=1"]
Module = Callable[[str], str]


def with_example(key: str, name: str, *more: str, of: str = "lane_change") -> Scenario:
    """A short scenario with the lines of an example, whose module is called `name`."""
    toml = EXAMPLES[key].toml.replace("mine.", f"{name}.")
    head = f'extends = "{of}"\nname = "own"\nduration_s = 1.0\n'
    return scenario_from_text(f"{head}{toml}", overrides=["convoy.vehicles=3", *more])


@pytest.mark.parametrize("key", EXAMPLES)
def test_the_example_of_a_point_runs_and_its_parameter_counts(
    key: str, module: Module, tmp_path: Path
) -> None:
    """The stored scenario is the same, and the module is part of the run's identity."""
    name = module(EXAMPLES[key].code)
    # 18 m is the gap that [speed.gap] requests: far below it, all laws brake at the limit.
    gap = ["convoy.gap_m=18"] if key == "control.longitudinal" else []
    scenario = with_example(key, name, *gap)
    assert [one.partition(".")[0] for one in scenario.plug_ins] == [name]
    again = scenario_from_text(scenario.text)
    assert again.text == scenario.text
    assert again.plug_ins == scenario.plug_ins
    summary = run_virtual(scenario, tmp_path / "own", Stop())
    assert summary.outcome == "completed", summary.reason
    assert list(summary.identity.plug_ins) == [name]
    overrides = ["convoy.vehicles=3", "duration_s=1", *gap]
    overrides += ["speed.followers=gap"] if gap else []
    usual = run_virtual(load_scenario("lane_change", overrides), tmp_path / "usual", Stop())
    assert (summary.vehicles, summary.events) != (usual.vehicles, usual.events)


LATERAL = """
import random
from dataclasses import dataclass
from pydantic import BaseModel
from vehicles.driver.steering import FeedforwardFeedback, SteeringCommand

class Law(FeedforwardFeedback):
    @dataclass
    class Settings:
        share: float = 1.0

    def __init__(self, parameters, gains, settings):
        super().__init__(parameters, gains)
        self.share = settings.share

    def steer(self, errors, speed):
        command = super().steer(errors, speed)
        return SteeringCommand(self.share * command.steering, 0.0, 0.0)

class Modelled(Law):
    class Settings(BaseModel):
        share: float = 1.0

class Floats(Law):
    def steer(self, errors, speed):
        return 0.0

class Nan(Law):
    def steer(self, errors, speed):
        return SteeringCommand(float("nan"), 0.0, 0.0)

class Raises(Law):
    def __init__(self, parameters, gains, settings):
        raise RuntimeError("of two\\nlines")

class Random(Law):
    def steer(self, errors, speed):
        return SteeringCommand(random.random(), 0.0, 0.0)

class Listed(Law):
    Settings = ["share"]

class Mute:
    pass

function = Law
def function(): pass
"""
MISTAKES = {
    "a missing module": ("nobody.Law", "", "No module named 'nobody', neither in the working"),
    "a missing class": ("M.Nobody", "", "has no class 'Nobody'"),
    "no class": ("M.function", "", "not a class with a method steer(errors, speed)"),
    "no method": ("M.Mute", "", "not a class with a method steer(errors, speed)"),
    "an unknown parameter": ("M.Law", "shares = 1.0", "shares: unknown key, did you mean"),
    "a wrong type": ("M.Law", "share = 'a'", 'share: given "a", allowed a number'),
    "not finite": ("M.Modelled", "share = nan", "share: given nan, allowed a finite number"),
    "no settings": ("M.Listed", "", "Settings is not a dataclass or a Pydantic model"),
    "a wrong result": ("M.Floats", "", "steer() returned float, expected a SteeringCommand"),
    "a result that is not finite": ("M.Nan", "", "steer() returned steering = nan, expected a"),
    "a constructor that raises": ("M.Raises", "", "RuntimeError: of two lines"),
    "global random numbers": ("M.Random", "", "results differ between equal calls"),
    "a parameter of a class without any": ("stanley", "share = 1.0", "share: unknown key"),
    "an unknown short name": ("stanly", "", 'given "stanly", allowed "slip_compensated"'),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_clear_line(mistake: str, module: Module) -> None:
    use, parameter, wanted = MISTAKES[mistake]
    use = use.replace("M.", f"{module(LATERAL)}.")
    text = f'extends = "lane_change"\nname = "own"\n[control.controller]\nuse = "{use}"\n'
    with pytest.raises(ScenarioError) as refused:
        scenario_from_text(text + parameter)
    (line,) = refused.value.lines
    assert line.startswith("scenario: control.controller")
    assert wanted in line


@pytest.mark.parametrize("use", ["M.Modeled", "M_.Modelled"])
def test_a_similar_own_class_is_suggested(
    use: str, module: Module, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    name = module(LATERAL)
    given = use.replace("M", name, 1)
    with pytest.raises(ScenarioError) as refused:
        load_scenario("lane_change", [f"control.controller={given}"])
    assert f"{name}.Modelled?" in refused.value.lines[0]


def test_parameters_reach_the_class_also_by_vehicle_and_model(module: Module) -> None:
    name = module(LATERAL)
    own = f"vehicle.v2.control.controller={{use='{name}.Modelled',share=0.25}}"
    scenario = load_scenario("lane_change", [f"control.controller.use={name}.Law", own])
    errors = TrackingErrors(lateral=0.0, heading=0.1, yaw_rate=0.0, curvature=0.0)
    first, second = (scenario.vehicle(one).controller().steer(errors, 9.0) for one in ("v1", "v2"))
    assert second.steering == 0.25 * first.steering != 0.0
    assert scenario.plug_ins == [f"{name}.Law", f"{name}.Modelled"]


CHANNEL = """
import random
from transport.links.laws.delays import BaseDelay
from transport.links.laws.burst_losses import BaseLoss

class Half(BaseLoss):
    ratio: float
    def judge(self, draw, context):
        return "loss" if draw("half", context.seq) < self.ratio else 0

class Dice(BaseLoss):
    def judge(self, draw, context):
        return "loss" if random.random() < 0.5 else 0

class Wordy(BaseLoss):
    def judge(self, draw, context):
        return "swallowed"

class Silent(BaseLoss):
    pass

class Nan(BaseDelay):
    def judge(self, draw, context):
        return float("nan")

class Late(BaseDelay):
    def judge(self, draw, context):
        if context.seq == 30:
            raise RuntimeError("too late")
        return 0
"""
EMISSION = """
from dataclasses import dataclass
from vehicles.car.gnss_error_terms import ErrorTerm
from vehicles.car.sending_rules import SendingRule

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
DRIVING = """
import time
from vehicles.driver.reactions import Extrapolate

class Undecided:
    def __init__(self, setup):
        pass
    def acceleration(self, speed, ahead):
        return None

class Clocked(Undecided):
    def acceleration(self, speed, ahead):
        return time.perf_counter()

class Bare:
    def fuse(self, sources, settings):
        return 1.0

class Needy(Bare):
    def __init__(self, draw, more):
        pass

class Brakes(Extrapolate):
    def acceleration(self, situation, mode, speed, wanted):
        return float("-inf")

class Truthy:
    def holds(self, pose):
        return 1

class Infinite:
    def add(self, pose):
        pass
    def value(self):
        return float("inf")
"""
OTHER_MISTAKES = {
    "control.longitudinal=D.Undecided": "control.longitudinal: controller 'D.Undecided': accelera",
    "control.longitudinal=D.Clocked": "control.longitudinal: results differ between equal calls",
    "control.longitudinal=D.Bare": "control.longitudinal: controller 'D.Bare': not a class with a",
    "control.fusion=D.Bare": "control.fusion: fusion 'D.Bare': fuse() returned float, expected a",
    "control.fusion=D.Needy": "control.fusion: fusion 'D.Needy': cannot be built as Needy(draw=dr",
    "control.degradation.reaction=D.Brakes": "control.degradation.reaction: reaction 'D.Brakes': a",
    "event=[{use='D.Truthy'}]": "event[0]: event 'D.Truthy': holds() returned 1, expected True or",
    "event=[{use='D.Truthy',more=1}]": "event[0].more: unknown key",
    "figure=[{use='D.Infinite'}]": "figure[0]: figure 'D.Infinite': value() returned inf, expected",
    "links.loss={use='C.Half'}": "links.loss.ratio: missing",
    "links.loss={use='C.Half',ratio='a'}": 'links.loss.ratio: given "a", allowed a number',
    "links.loss=C.Dice": "links.loss: law 'C.Dice': judge() has other verdicts if messages come in",
    "links.loss=C.Wordy": "links.loss: law 'C.Wordy': judge() returned 'swallowed', expected a",
    "links.loss=C.Silent": "links.loss: law 'C.Silent': judge() raised NotImplementedError",
    "links.delay=C.Half": "links.delay: law 'C.Half': not a class with the base transport.links",
    "links.delay=C.Nan": "links.delay: law 'C.Nan': judge() returned nan, expected a whole number",
    "vehicle.v2.sending={use='E.Truthy'}": "vehicle.v2.sending: sending rule 'E.Truthy': due() ret",
    "gnss.errors=[{use='E.Flat'}]": "gnss.errors[0]: error 'E.Flat': at() returned 0.1, expected",
    "gnss.errors=[{use='E.None'}]": "gnss.errors[0]: error 'E.None': module 'E' has no class",
}


@pytest.mark.parametrize("mistake", OTHER_MISTAKES)
def test_a_mistake_at_another_point_is_one_clear_line(mistake: str, module: Module) -> None:
    names = {"C": module(CHANNEL), "E": module(EMISSION), "D": module(DRIVING)}
    gap = ["speed.followers=gap"] if "longitudinal" in mistake else []
    with pytest.raises(ScenarioError) as refused:
        load_scenario("lane_change", [*gap, _named(mistake, names)])
    (line,) = refused.value.lines
    wanted = OTHER_MISTAKES[mistake]
    for short, name in names.items():
        line = line.replace(f"'{name}'", f"'{short}'").replace(f"'{name}.", f"'{short}.")
    assert line.startswith(f"--set: {wanted}")


def _named(text: str, names: Mapping[str, str]) -> str:
    for short, name in names.items():
        text = re.sub(rf"(?<=[='\"]){short}\.", f"{name}.", text)
    return text


def test_a_law_that_raises_fails_the_run_of_the_receiver(module: Module, tmp_path: Path) -> None:
    name = module(CHANNEL)
    link = f"link=[{{sender='v1',receiver='v2',delay={{use='{name}.Late'}}}}]"
    scenario = load_scenario("lane_change", ["convoy.vehicles=2", "duration_s=3", link])
    summary = run_virtual(scenario, tmp_path, Stop())
    wanted = f"v2: law '{name}.Late': judge() raised RuntimeError: too late, "
    assert (summary.outcome, summary.reason[: len(wanted)]) == ("failed", wanted)


def test_a_law_of_ones_own_equals_the_shipped_one(module: Module) -> None:
    """Of a law with the purpose and the ratio of `loss_ratio`, each verdict is the same."""
    code = CHANNEL.replace('draw("half"', 'draw("loss"')
    own = load_scenario("lane_change", [f"links.loss={{use='{module(code)}.Half',ratio=0.4}}"])
    shipped = load_scenario("lane_change", ["links.loss_ratio=0.4"])
    verdicts = []
    for scenario in (own, shipped):
        link = Link(link_effects(scenario.links["v1", "v2"], 20.0), 1, "v1", "v2")
        verdicts.append([link.judge(TransmissionContext(seq, seq * 10**8)) for seq in range(200)])
    assert verdicts[0] == verdicts[1]
    assert 0.3 < sum(one.outcome == "dropped" for one in verdicts[0]) / 200 < 0.5


def test_a_loss_law_of_a_dozen_lines_runs_from_the_command_line(
    module: Module, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Messages over two gaps are lost more often than those over one, as the law states."""
    code = EXAMPLES["links.loss"].code
    assert len(code.split("\n")) <= 12
    monkeypatch.chdir(tmp_path)
    loss = f'links.loss={{use="{module(code)}.LossOverDistance",reach_m=60}}'
    options = ["--set", loss, *(f"--set={one}" for one in ("convoy.vehicles=3", "duration_s=2"))]
    ran = CliRunner().invoke(cli, ["run", "lane_change", *options, "--clock=virtual", "--out=out"])
    assert ran.exit_code == 0, ran.output
    links = from_json((tmp_path / "out" / "summary.json").read_text()).links
    lost = {(one.sender, one.receiver): one.loss_ratio for one in links}
    spacing = load_scenario("lane_change").route.spacings[1]
    for pair, gaps in ((("v1", "v2"), 1), (("v2", "v3"), 1), (("v1", "v3"), 2)):
        expected = (gaps * spacing / 60) ** 2
        assert lost[pair] == pytest.approx(expected, abs=3 * (expected / 40) ** 0.5)
    assert (lost["v1", "v3"] or 0) > (lost["v1", "v2"] or 0)


def test_a_log_is_readable_without_the_modules_of_its_classes(
    module: Module, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, channel = module(LATERAL), module(CHANNEL)
    own = [f"control.controller={{use='{name}.Law',share=0.9}}"]
    own += [f"links.loss={{use='{channel}.Half',ratio=0.5}}"]
    run_virtual(load_scenario("lane_change", [*TWO, *own]), tmp_path / "run", Stop())
    for gone in (name, channel):
        monkeypatch.delitem(sys.modules, gone)
        (tmp_path / f"{gone}.py").unlink()
    monkeypatch.setattr(table, "_TABLES", {})
    importlib.invalidate_caches()
    assert from_json((tmp_path / "run" / "summary.json").read_text()).links[0].judged == 20
    ran = CliRunner().invoke(cli, ["explain", str(tmp_path / "run"), "--vehicle=v2", "--at=0.9"])
    assert ran.exit_code == 0, ran.output


MEASURES = """
class Every:
    def holds(self, pose):
        return pose.seq % 2 == 0

class Faulty(Every):
    def holds(self, pose):
        return 1 / (pose.seq - 30) < 9.0

class Distance:
    def __init__(self):
        self.last = None
    def add(self, pose):
        self.last = pose.distance_m
    def value(self):
        return self.last

class Text(Distance):
    def value(self):
        return "far"
"""


def test_own_events_and_figures_are_in_the_summary(module: Module, tmp_path: Path) -> None:
    name = module(MEASURES)
    own = [f"event=[{{use='{name}.{one}'}}]" for one in ("Every",)]
    own += [f"figure=[{{use='{name}.Distance'}}]"]
    summary = run_virtual(load_scenario("lane_change", [*TWO, *own]), tmp_path, Stop())
    assert [row.own_figures for row in summary.vehicles] == [
        {"Distance": row.distance_m} for row in summary.vehicles
    ]
    assert {(one.name, *one.vehicles) for one in summary.events} == {
        ("Every", "v1"),
        ("Every", "v2"),
    }
    assert from_json((tmp_path / "summary.json").read_text()).events == summary.events
    assert summary.outcome_line.endswith(", 2 own events")


def test_a_measure_that_fails_is_left_out_with_a_warning(module: Module, tmp_path: Path) -> None:
    own = f"event=['{module(MEASURES)}.Faulty']"
    summary = run_virtual(load_scenario("lane_change", [*TWO, own]), tmp_path, Stop())
    assert summary.outcome == "completed"
    assert [line.partition(": holds() ")[2] for line in summary.warnings] == [
        "raised ZeroDivisionError: division by zero; left out"
    ] * 2
