"""Random scenarios run to their end or are refused in lines, and are reported correctly.

`pytest --campaign` draws some hundred of each kind.
"""

import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from functools import cache
from math import isfinite
from pathlib import Path
from random import Random
from typing import Any

import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.definition.check import steering_loop
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, load_scenario
from tests.made.scenarios.drawn_scenarios import drawn_scenario
from tests.made.transport.links import link as link_of
from transport.codec import encode
from transport.links.laws.link_law import TransmissionContext
from transport.log.reader import LogReader
from vehicles.messages import GpsPose, LinkVerdict, LogText, Message, RunEnd, TruePose
from vehicles.schedule import MILLISECOND
from vehicles.theory.sampled_loop import SampledLoop, sampled_decay

TWICE = 6
"""Interval of the scenarios that run twice."""
COUNTED = {
    "collisions_max": "collision",
    "lane_departures_max": "lane_departure",
    "near_misses_max": "near_miss",
    "paths_lost_max": "path_lost",
}


@pytest.fixture(scope="module", autouse=True)
def search_remedies_at_one_rate(request: pytest.FixtureRequest) -> Iterator[None]:

    def at_the_highest(
        loop_at: Callable[[float], SampledLoop], speed: float, most: int
    ) -> int | None:
        return most if sampled_decay(loop_at(most), speed) > 0.0 else None

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(steering_loop, "_remedy", cache(steering_loop._remedy))
        if not request.config.getoption("--campaign"):
            patch.setattr(steering_loop, "lowest_stable_rate", at_the_highest)
        yield


def convoy(*arguments: str | Path) -> Result:
    """Run a command in this process; it must not raise."""
    result = CliRunner().invoke(cli, list(map(str, arguments)))
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exc_info
    assert result.exit_code in {0, 1, 2}
    assert "Traceback" not in result.stderr
    assert all(line and line.isprintable() for line in result.stderr.splitlines()), result.stderr
    return result


def strict(text: str) -> Any:
    """Read JSON without NaN and infinity."""

    def refuse(word: str) -> None:
        raise AssertionError(word)

    return json.loads(text, parse_constant=refuse)


def run(file: Path, folder: Path) -> Result:
    return convoy("run", file, "--clock=virtual", "--quiet", f"--out={folder}")


@pytest.mark.campaign(12, 300)
def test_a_random_scenario_is_run_and_reported_correctly(case: int, tmp_path: Path) -> None:
    file = drawn_scenario(Random(case), tmp_path)
    checked = convoy("check", file, "--json")
    ran = run(file, tmp_path / "run")
    if checked.exit_code == 2:
        assert ran.stderr == checked.stderr
        assert_refused(ran, tmp_path)
        return
    strict(checked.stdout)
    summary = strict((tmp_path / "run" / "summary.json").read_text())
    assert ran.exit_code == (summary["outcome"] != "completed")
    assert convoy("report", tmp_path / "run", "--json").stdout == (
        (tmp_path / "run" / "summary.json").read_text()
    )
    scenario = load_scenario(file)
    log = LogReader(tmp_path / "run" / "run.mcap")
    assert not log.truncated
    assert not log.damage
    messages = [message for _, _, message in log.messages()]
    assert len(messages) == sum(log.counts.values())
    assert_accounted(scenario, summary, messages)
    assert_events(scenario, summary, messages)
    if case % TWICE == 0:
        run(file, tmp_path / "again")
        assert (tmp_path / "again" / "run.mcap").read_bytes() == log.path.read_bytes()


def test_most_random_scenarios_can_run(tmp_path: Path) -> None:
    count, refused = 24, 0
    for case in range(count):
        try:
            load_scenario(drawn_scenario(Random(case), tmp_path))
        except ScenarioError:
            refused += 1
    assert refused < 0.3 * count


def assert_refused(result: Result, folder: Path) -> None:
    assert result.exit_code == 2
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert lines
    for error in lines:
        assert error.startswith("error: ")
        line = error.removeprefix("error: ")
        assert line.startswith((str(folder), "drawn.toml")), line
    assert not (folder / "run").exists()


def assert_accounted(scenario: Scenario, summary: Any, messages: list[Message]) -> None:
    sent: defaultdict[str, dict[int, GpsPose]] = defaultdict(dict)
    judged: defaultdict[tuple[str, str], dict[int, LinkVerdict]] = defaultdict(dict)
    last: dict[str, int] = {}
    for message in messages:
        if isinstance(message, GpsPose):
            sent[message.vehicle][message.seq] = message
        elif isinstance(message, LinkVerdict):
            assert message.pose_seq not in judged[message.sender, message.vehicle]
            judged[message.sender, message.vehicle][message.pose_seq] = message
        elif isinstance(message, TruePose):
            last[message.vehicle] = message.true_at_ns
    refused: Counter[str] = Counter()
    for row in summary["links"]:
        pair = (row["sender"], row["receiver"])
        verdicts = judged[pair]
        dropped = Counter(one.reason for one in verdicts.values() if one.outcome == "dropped")
        assert (row["sent"], row["judged"]) == (len(sent[pair[0]]), len(verdicts))
        assert row["dropped"] == dict(dropped)
        assert row["delivered"] == len(verdicts) - dropped.total()
        due_at = latest(scenario, pair, sent[pair[0]])
        due = [seq for seq, at in due_at.items() if at < last.get(pair[1], 0)]
        refused[pair[1]] += len([seq for seq in due if seq not in verdicts])
        assert verdicts.keys() <= sent[pair[0]].keys()
    for row in summary["vehicles"]:
        assert row["rejected_messages"] >= refused[row["name"]]
        if not refused[row["name"]]:
            continue
        texts = [m.text for m in messages if isinstance(m, LogText) and m.vehicle == row["name"]]
        assert any("refused" in text for text in texts)
    assert all(row["missing_poses"] == 0 for row in summary["vehicles"])
    assert summary["recorder_rejected_messages"] == {}


def latest(scenario: Scenario, pair: tuple[str, str], sent: dict[int, GpsPose]) -> dict[int, int]:
    """Latest time (ns) at which the fate of each message is known, by its number.

    Where and whether others were lost does not matter: they are all taken to have come, in line
    with a queue that is full.
    """
    table, rate_hz = scenario.links[pair], scenario.vehicle(pair[0]).gnss.rate
    link = link_of(table, *pair, seed=scenario.seed, rate_hz=rate_hz)
    further_ms = table.content.reorder_delay_ms if table.content else 0.0
    if table.queue is not None:
        longest = max((len(encode(one)) for one in sent.values()), default=0)
        waiting = min(table.queue.depth_messages, len(sent)) + 2
        further_ms += 1000.0 * waiting * longest / table.queue.bytes_per_s
    found, before = {}, 0
    for seq, pose in sorted(sent.items()):
        own = link.judge(TransmissionContext(seq, pose.sent_at_ns)).visible_at
        before = max(before, own) if table.delay and table.delay.order == "in_order" else own
        found[seq] = before + round(further_ms * MILLISECOND)
    return found


def assert_events(scenario: Scenario, summary: Any, messages: list[Message]) -> None:
    names, events = list(scenario.vehicle_names), summary["events"]
    lines = [m.text for m in messages if isinstance(m, LogText) and m.level in {"warning", "error"}]
    assert [event["at_s"] for event in events] == sorted(event["at_s"] for event in events)
    for event in events:
        assert 0.0 <= event["at_s"] <= summary["ran_s"]
        assert event["vehicles"] == sorted(event["vehicles"], key=names.index)
        of_two = event["kind"] in {"collision", "near_miss", "distrust"}
        assert len(event["vehicles"]) == (2 if of_two else 1)
        assert all(isfinite(value) for value in event["figures"].values())
        what = event["kind"].replace("_", " ")
        assert any(
            line.startswith(what) and all(name in line for name in event["vehicles"])
            for line in lines
        ), event
    rows = {row["name"]: row for row in summary["vehicles"]}
    for event in events:
        places = list(map(names.index, event["vehicles"]))
        if event["kind"] == "collision" and places[1] == places[0] + 1:
            assert rows[event["vehicles"][1]]["true_gap_m_min"] == 0.0
    (end,) = (message for message in messages if isinstance(message, RunEnd))
    assert end.reason == summary["reason"]
    counts = Counter(event["kind"] for event in events)
    for limit, kind in COUNTED.items():
        most = getattr(scenario.tables.limits, limit)
        broken_now = most is not None and counts[kind] > most
        assert broken_now == (f"limits.{limit} =" in summary["reason"]), limit
    if not summary["reason"]:
        assert summary["ran_s"] == pytest.approx(scenario.duration_s)
