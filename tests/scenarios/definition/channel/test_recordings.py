"""Recorded losses read into a scenario: CSV patterns, and the links of an earlier run."""

from pathlib import Path

import pytest

from scenarios.definition.channel.build import link_effects
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.scenarios.messages import STRAIGHT
from transport.links.laws.link_law import TransmissionContext
from transport.links.laws.recorded_losses import EarlierRun, RecordedPattern
from transport.links.link import Link
from transport.log.reader import LogReader
from vehicles.messages import LinkVerdict

PATTERN = "number,received\n100,1\n101,0\n102,0\n103,1\n104,FALSE\n\n105,true\n"


def scenario(folder: Path, *overrides: str) -> Scenario:
    return scenario_from_text(STRAIGHT, label="a.toml", overrides=overrides, folder=folder)


@pytest.mark.parametrize("text", [PATTERN, "\ufeff" + PATTERN, PATTERN.replace(",", " , ")])
def test_a_pattern_is_read_and_depends_on_no_file_any_more(tmp_path: Path, text: str) -> None:
    (tmp_path / "loss.csv").write_text(text)
    read = scenario(tmp_path, "links.loss={kind='pattern', file='loss.csv'}")
    (tmp_path / "loss.csv").unlink()
    law, _ = link_effects(read.links["v1", "v2"], 20.0)
    assert law == RecordedPattern(source="loss.csv", length_messages=6, lost_numbers="1-2, 4")
    again = scenario_from_text(read.text)
    assert again.tables == read.tables
    assert 'source = "loss.csv"' in read.text


REFUSED = {
    "empty": ("", 'header "", allowed "number,received"'),
    "another header": ("seq,ok\n1,1\n", 'header "seq,ok", allowed "number,received"'),
    "nothing below": ("number,received\n", "no messages below the header"),
    "a hole": ("number,received\n1,1\n3,1\n", "line 3: number 3, allowed 2, the next one"),
    "twice": ("number,received\n1,1\n1,1\n", "line 3: number 1, allowed 2, the next one"),
    "no number": ("number,received\n-1,1\n", 'line 2: number "-1", allowed a whole number'),
    "neither": ("number,received\n1,0.5\n", 'line 2: received "0.5", allowed 0 or 1'),
    "three cells": ("number,received\n1,0,1\n", "line 2: 3 cells, allowed 2"),
}


@pytest.mark.parametrize(("text", "why"), REFUSED.values(), ids=REFUSED)
def test_a_broken_pattern_is_refused_in_one_line(tmp_path: Path, text: str, why: str) -> None:
    (tmp_path / "loss.csv").write_text(text)
    with pytest.raises(ScenarioError) as caught:
        scenario(tmp_path, "link=[{sender='*', receiver='v2'}]",
                 "link.0.loss={kind='pattern', file='loss.csv'}")  # fmt: skip
    (line,) = caught.value.lines
    assert line.startswith("--set: link[0].loss.file: loss.csv: ")
    assert why in line


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"\xff\xfe", "utf-8"),
        (b"no log at all", "damaged|not|no MCAP|magic"),
        (None, "no such file"),
    ],
)
def test_files_that_are_something_else_are_refused(
    tmp_path: Path, content: bytes | None, why: str
) -> None:
    if content is not None:
        (tmp_path / "a.bin").write_bytes(content)
    kind = "pattern" if content == b"\xff\xfe" else "log"
    with pytest.raises(ScenarioError, match=why) as caught:
        scenario(tmp_path, f"links.loss={{kind='{kind}', file='a.bin'}}")
    (line,) = caught.value.lines
    assert line.startswith("--set: links.loss.file: a.bin: ")


# ---- The same channel again

LOSSY = (
    "duration_s=6", "links={loss_ratio=0.2, latency_ms=15.0, jitter_ms=90.0}",
    "link=[{sender='v1', receiver='v3', rate_hz=7.0, "
    "loss={kind='gilbert_elliott', loss_ratio=0.3, burst_messages_mean=4.0}}]",
)  # fmt: skip


def verdicts(log: Path) -> dict[tuple[str, str], dict[int, tuple[str, str, int]]]:
    found: dict[tuple[str, str], dict[int, tuple[str, str, int]]] = {}
    for _, receiver, one in LogReader(log).messages(("verdict",)):
        assert isinstance(one, LinkVerdict)
        judged = one.outcome, one.reason, one.visible_at_ns - one.sent_at_ns
        found.setdefault((one.sender, receiver), {})[one.pose_seq] = judged
    return found


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("earlier")
    run_virtual(scenario(folder, *LOSSY), folder / "run", Stop())
    return folder


def test_the_same_channel_again_gives_the_same_verdicts(earlier: Path, tmp_path: Path) -> None:
    """Another seed, another speed, but what each message meets is the earlier run's."""
    again = scenario(
        earlier, "duration_s=6", "seed=9", "links.loss={kind='log', file='run/run.mcap'}"
    )
    run_virtual(again, tmp_path / "run", Stop())
    before, after = verdicts(earlier / "run" / "run.mcap"), verdicts(tmp_path / "run" / "run.mcap")
    assert before.keys() == after.keys() == again.links.keys()
    reasons = set[str]()
    for link, judged in before.items():
        assert len(judged) > 100
        assert {number: after[link].get(number) for number in judged} == judged
        reasons |= {reason for _, reason, _ in judged.values()}
    assert reasons == {"", "loss", "rate", "burst"}


def test_a_record_is_put_into_the_scenario(earlier: Path) -> None:
    again = scenario(earlier, "duration_s=6", "links.loss={kind='log', file='run/run.mcap'}")
    assert again.tables.links.loss is None
    assert {(one.sender, one.receiver) for one in again.tables.link} == set(again.links)
    assert scenario_from_text(again.text).tables == again.tables
    recorded = verdicts(earlier / "run" / "run.mcap")
    for pair, table in again.links.items():
        link = Link(link_effects(table, 20.0), 5, *pair)
        law = link.effects[0]
        assert isinstance(law, EarlierRun)
        assert law.length == max(recorded[pair]) + 1
        for number, (_, reason, delay) in recorded[pair].items():
            judged = link.judge(TransmissionContext(number, 1000))
            assert (judged.reason, judged.visible_at) == (reason, 1000 + delay)
            assert link.judge(TransmissionContext(number + law.length, 0)).reason == reason


def test_a_link_that_the_log_does_not_hold_is_named_with_those_it_does(earlier: Path) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario(earlier, "links.loss={kind='log', file='run/run.mcap', sender='v9'}")
    (line,) = caught.value.lines
    assert line == (
        "--set: links.loss.file: run/run.mcap: no verdicts of v9 → v1, allowed v1 → v2, v1 → v3, "
        "v1 → v4, v2 → v1, v2 → v3, v3 → v1, v3 → v4"
    )
