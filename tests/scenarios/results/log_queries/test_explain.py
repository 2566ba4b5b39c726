"""`convoy explain` against a plain reading of the log."""

import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from math import hypot
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

from scenarios.cli.log_commands import explain as explain_command
from scenarios.definition.scenario import load_scenario
from scenarios.results.explain import (
    IN_TRANSIT,
    Explanation,
    explain,
    explanation,
    remaining_path_length,
)
from scenarios.results.log_summary import tables_of
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.transport.changed_logs import changed_log
from transport import convoy_pb2
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import Command, Message, Tracking

INSTANTS = 40
OVERRIDES = [
    "duration_s=12.0",
    "links.loss_ratio=0.3",
    "links.jitter_ms=120.0",
    'link=[{sender="lead", receiver="v4", loss_ratio=0.6, latency_ms=150.0},'
    '{sender="v2", receiver="v3", rate_hz=5.0}]',
]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("explained")
    run_virtual(load_scenario("lane_change", OVERRIDES), folder, Stop())
    return folder / "run.mcap"


Record = dict[tuple[str, str], list[Any]]


@pytest.fixture(scope="module")
def plain(log: Path) -> Record:
    """All messages by vehicle and topic, read without any code of the project's but the schema."""
    found: Record = {}
    with log.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            parts = channel.topic.split("/")
            if schema is not None and schema.name.startswith("convoy.") and len(parts) == 4:
                kind = getattr(convoy_pb2, schema.name.removeprefix("convoy."))
                found.setdefault((parts[2], parts[3]), []).append(kind.FromString(message.data))
    return found


def instants() -> Iterator[tuple[str, float]]:
    random = Random(12)
    for _ in range(INSTANTS):
        yield random.choice(["v1", "v2", "v3", "v4"]), round(random.uniform(0.0, 11.9), 3)


def senders(vehicle: str) -> list[str]:
    return {"v1": ["v2", "v3"], "v2": ["v1"], "v3": ["v1", "v2"], "v4": ["v1", "v3"]}[vehicle]


def check_source(
    plain: Record, plane: LocalPlane, found: Explanation, start: int, now: int
) -> None:
    vehicle = found.vehicle
    for source in found.sources:
        verdicts = [v for v in plain[vehicle, "verdict"] if v.sender == source.sender]
        received = [v for v in verdicts if v.outcome == "delivered" and v.received_at_ns <= now]
        if not received:
            assert source.number is None
            assert source.age_s is source.path_left_m is None
        else:
            best = max(received, key=lambda v: v.measured_at_ns)
            assert source.number == best.pose_seq
            assert source.age_s == pytest.approx((now - best.measured_at_ns) / 1e9)
            assert source.received_at_s == pytest.approx((best.received_at_ns - start) / 1e9)
            numbers = {v.pose_seq for v in received}
            places = [
                plane.to_plane(g.latitude_deg, g.longitude_deg, g.altitude_m)
                for g in plain[source.sender, "gps"] if g.seq in numbers
            ]  # fmt: skip
            here = next(t for t in plain[vehicle, "truth"] if t.true_at_ns == now)
            assert source.path_left_m == pytest.approx(
                brute_way_left(places, (here.east_m, here.north_m)), abs=0.05
            )
        later = [
            g for g in plain[source.sender, "gps"]
            if g.sent_at_ns <= now and g.seq > (-1 if source.number is None else source.number)
        ]  # fmt: skip
        assert [m.number for m in source.missing] == [g.seq for g in later]
        fates = {v.pose_seq: v for v in verdicts}
        for missing in source.missing:
            fate = fates.get(missing.number)
            if fate is None:
                assert missing.fate == IN_TRANSIT
            elif fate.outcome == "dropped":
                assert missing.fate == fate.reason
                assert missing.cause == cause(source.sender, vehicle, fate.reason)
            else:
                assert missing.fate == IN_TRANSIT
                assert fate.received_at_ns > now
        due = [v for v in verdicts if now - 10**9 < v.received_at_ns <= now]
        if due:
            share = sum(v.outcome == "delivered" for v in due) / len(due)
            assert source.received_ratio == pytest.approx(share)


def cause(sender: str, receiver: str, reason: str) -> str:
    if reason == "rate":
        assert (sender, receiver) == ("v2", "v3")
        return "link[1].rate_hz = 5 (v2 → v3)"
    if (sender, receiver) == ("v1", "v4"):
        return "link[0].loss_ratio = 0.6 (lead → v4)"
    return "links.loss_ratio = 0.3"


def brute_way_left(places: list[tuple[float, float]], here: tuple[float, float]) -> float:
    """Length from the nearest of many points on the polyline to its end."""
    ends = np.array(places)
    fine = [ends[:1]]
    for before, after in pairwise(ends):
        steps = max(1, int(hypot(*(after - before)) / 0.01))
        fine.append(before + np.arange(1, steps + 1)[:, None] / steps * (after - before))
    points = np.concatenate(fine)
    nearest = int(np.argmin(np.hypot(*(points - here).T)))
    return float(np.hypot(*np.diff(points[nearest:], axis=0).T).sum())


def test_explanations_of_many_instants_match_the_log(log: Path, plain: Record) -> None:
    start = plain["run", "start"][0].start_at_ns
    run = tables_of(log)
    plane = LocalPlane(load_scenario("lane_change").origin)
    reported = 0
    for vehicle, at_s in instants():
        found = explanation(run, vehicle, at_s)
        requested = start + round(at_s * 1e9)
        decision = [t for t in plain[vehicle, "tracking"] if t.decided_at_ns <= requested][-1]
        assert found.decided_at_s == pytest.approx((decision.decided_at_ns - start) / 1e9)
        assert (found.mode, found.reason) == (decision.mode, decision.reason)
        assert [source.sender for source in found.sources] == senders(vehicle)
        check_source(plain, plane, found, start, decision.decided_at_ns)
        for source in found.sources:
            is_lead = source.sender == "v1"
            status = decision.lead_status if is_lead else decision.predecessor_status
            assert source.status == ("" if vehicle == "v1" else status)
        assert all(source.sender in found.sentence for source in found.sources)
        reported += len(found.sources)
    assert reported > INSTANTS  # the draw is not of leads only


def test_the_command_prints_the_sentence_and_its_twin_for_machines(log: Path) -> None:
    arguments = [str(log), "--vehicle", "v4", "--at", "7.5"]
    printed = CliRunner().invoke(explain_command, arguments)
    assert printed.exit_code == 0
    found = explain(log, "v4", 7.5)
    assert found.sentence in printed.output
    table = json.loads(CliRunner().invoke(explain_command, [*arguments, "--json"]).output)
    assert table["sentence"] == found.sentence
    assert [one["sender"] for one in table["sources"]] == ["v1", "v3"]


def test_an_override_is_explained_with_its_evidence(log: Path, tmp_path: Path) -> None:
    reason = "braking: v2 announced a stop, last pose 0.40 s ago"

    def overridden(message: Message) -> Message:
        if message.vehicle != "v4":
            return message
        if isinstance(message, Command):
            figures = {"acceleration_mps2": -4.0, "law_acceleration_mps2": 0.25}
            return replace(message, override="announced stop", **figures)  # type: ignore[arg-type]
        return replace(message, reason=reason) if isinstance(message, Tracking) else message

    found = explain(changed_log(log, tmp_path / "run.mcap", overridden), "v4", 7.5)
    assert (found.acceleration_mps2, found.law_acceleration_mps2) == (-4.0, 0.25)
    assert found.override == "announced stop"
    assert reason in found.sentence


@pytest.mark.parametrize(
    ("vehicle", "at", "words"),
    [
        ("v9", "1", "no vehicle 'v9', allowed v1, v2, v3, v4"),
        ("v3", "12.5", "v3 has no decision at 12.5 s, allowed 0 to 11.98"),
    ],
)
def test_values_outside_of_the_log_are_refused_in_one_line(
    log: Path, vehicle: str, at: str, words: str
) -> None:
    result = CliRunner().invoke(explain_command, [str(log), "--vehicle", vehicle, "--at", at])
    assert result.exit_code == 2
    assert words in result.output
    assert result.output.count("\n") == 1


def test_the_remaining_path_is_that_of_the_last_lap() -> None:
    square = [(0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)]
    laps = np.array([*square, *square, *square])
    assert remaining_path_length(laps, np.array([50.0, 1.0])) == pytest.approx(250.0)


def test_ages_of_poses_are_by_the_vehicle_s_own_clock(tmp_path: Path) -> None:
    clocks = ["vehicle.v2.clock={offset_ms=150.0}", "vehicle.v3.clock={offset_ms=-400.0}"]
    run_virtual(load_scenario("lane_change", ["duration_s=3.0", *clocks]), tmp_path, Stop())
    run = tables_of(tmp_path / "run.mcap")
    tracking = run.table("v3", "tracking")
    found = explanation(run, "v3", run.seconds(tracking.at_ns[100]))
    ages = {source.sender: source.age_s for source in found.sources}
    assert ages["v1"] == pytest.approx(tracking["lead_age_s"][100])
    assert ages["v2"] == pytest.approx(tracking["predecessor_age_s"][100])
    assert tracking["predecessor_age_s"][100] < -0.4
