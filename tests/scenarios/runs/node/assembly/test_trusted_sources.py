"""Sources of shipped scenarios are trusted; false content is named in the log."""

import pytest

from scenarios.definition.library import library
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.files import LOG_NAME
from scenarios.runs.node.driver_builder import DriverBuilder
from scenarios.runs.observer import OnMessage
from scenarios.runs.virtual import drive
from tests.made.scenarios.shipped import whole_run
from transport.codec import encode
from transport.log.reader import LogReader
from vehicles.messages import Command, LogText, Message
from vehicles.schedule import SECOND

THREE = "convoy.vehicles=3"
"""A lead, a follower of it alone, and a follower with two sources."""
WORDS = ("distrusted", "over-confident", "trusted again")


def driven(scenario: Scenario) -> tuple[list[str], list[bytes]]:
    """Logged texts about sources, by vehicle and time (s), and all commands."""
    reported: list[str] = []
    commands: list[bytes] = []

    def record(_at: int, message: Message) -> None:
        if isinstance(message, Command):
            commands.append(encode(message))
        elif isinstance(message, LogText) and any(word in message.text for word in WORDS):
            at = (message.logged_at_ns - scenario.start_at_ns) / SECOND
            reported.append(f"{at:.2f} {message.vehicle}: {message.text}")

    drive(scenario, [OnMessage(record)]).raise_fault()
    return reported, commands


WHOLE = ("church_lot", "highway", "lane_change")
"""Driven to their ends once for all tests."""
SHIPPED = [name for name in library() if name not in WHOLE]


@pytest.mark.spread(1)
@pytest.mark.parametrize("name", WHOLE)
def test_no_source_of_a_whole_drive_is_distrusted(
    name: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    log = LogReader(whole_run(name, tmp_path_factory) / LOG_NAME)
    texts = [
        message.text for _, _, message in log.messages(("log",)) if isinstance(message, LogText)
    ]
    assert len(texts) > 2  # at least one per link
    assert not [text for text in texts if any(word in text for word in WORDS)]


@pytest.mark.campaign(1, len(SHIPPED))
def test_no_source_of_a_shipped_scenario_is_distrusted(case: int) -> None:
    assert driven(load_scenario(SHIPPED[case]))[0] == []


@pytest.mark.parametrize("name", ["lossy_lane_change", "paper_field"])
def test_the_gate_leaves_commands_as_they_are(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario(name, ["duration_s=12", THREE])
    _, commands = driven(scenario)
    monkeypatch.setattr(DriverBuilder, "_receivers", lambda _builder: {})
    assert commands
    assert driven(scenario)[1] == commands


@pytest.mark.spread(2)
@pytest.mark.parametrize(
    "sending", ['{ kind = "cam" }', '{ kind = "intervals", table = "cam_vw_highway" }']
)
@pytest.mark.parametrize("name", ["highway", "church_lot"])
def test_sources_that_send_rarely_are_trusted(name: str, sending: str) -> None:
    assert driven(load_scenario(name, [f"sending={sending}", "duration_s=20", THREE]))[0] == []


def test_sources_with_an_intermittent_fix_are_trusted() -> None:
    states = """{ kind = "schedule", entries = [
        { at_s = 3.0, state = "float" }, { at_s = 8.0, state = "fixed" },
        { at_s = 12.0, state = "single" }, { at_s = 15.0, state = "fixed" } ] }"""
    requested = ['gnss.preset="rtk_fixed"', f"gnss.fix_states={states}", "duration_s=20", THREE]
    assert driven(load_scenario("highway", requested))[0] == []


@pytest.mark.parametrize(
    ("false", "line"),
    [
        ('{ kind = "frozen", from_s = 5.0, to_s = 7.0 }', "v2 distrusted: frozen"),
        (
            '{ kind = "replayed", age_s = 2.0, from_s = 5.0, to_s = 7.0 }',
            "v2 distrusted: jumping",
        ),
        ('{ kind = "ghost", left_m = 4.0, from_s = 5.0, to_s = 7.0 }', "v2 distrusted: ghost"),
    ],
)
def test_false_content_is_named_and_the_source_comes_back(false: str, line: str) -> None:
    requested = [f"links.content.false=[{false}]", "duration_s=12", THREE]
    reported, _ = driven(load_scenario("highway", requested))
    of_v2 = [one for one in reported if " v3: v2 " in one]
    assert any(line in one for one in of_v2)
    assert 5.0 <= float(of_v2[0].split()[0]) <= 5.1
    assert "trusted again" in of_v2[-1]
    assert float(of_v2[-1].split()[0]) <= 9.2


def test_baselines_of_degradation_believe_everything_as_they_did() -> None:
    false = 'links.content.false=[{ kind = "frozen", from_s = 5.0, to_s = 7.0 }]'
    requested = [false, "duration_s=8", THREE, 'control.degradation.reaction="extrapolate"']
    assert driven(load_scenario("highway", requested))[0] == []
