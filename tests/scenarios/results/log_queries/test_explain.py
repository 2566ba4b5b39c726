"""`convoy explain` against a plain reading of the log."""

import json
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
from numpy.typing import NDArray

from scenarios.cli.log_commands import explain as explain_command
from scenarios.definition.scenario import load_scenario
from scenarios.results.log_summary import tables_of
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from scenarios.studies.explain import (
    IN_TRANSIT,
    Explanation,
    KnownSource,
    explain,
    explanation,
    remaining_path_length,
)
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
SENDERS = {"v1": ["v2", "v3"], "v2": ["v1"], "v3": ["v1", "v2"], "v4": ["v1", "v3"]}
CAUSES = {
    ("v2", "v3", "rate"): "link[1].rate_hz = 5 (v2 → v3)",
    ("v1", "v4", "loss"): "link[0].loss_ratio = 0.6 (lead → v4)",
}
Record = dict[tuple[str, str], list[Any]]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("explained")
    run_virtual(load_scenario("lane_change", OVERRIDES), folder, Stop())
    return folder / "run.mcap"


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


def brute_way_left(places: NDArray[np.float64], here: NDArray[np.float64]) -> float:
    """Length from the nearest of many points on the polyline to its end."""
    fine = [places[:1]]
    for before, after in pairwise(places):
        steps = max(1, int(hypot(*(after - before)) / 0.01))
        fine.append(before + np.arange(1, steps + 1)[:, None] / steps * (after - before))
    points = np.concatenate(fine)
    nearest = int(np.argmin(np.hypot(*(points - here).T)))
    return float(np.hypot(*np.diff(points[nearest:], axis=0).T).sum())


def check(plain: Record, vehicle: str, source: KnownSource, now: int) -> None:
    """Compare what a vehicle knew of a source at an instant (ns) with the messages of the log."""
    sent, start = plain[source.sender, "gps"], plain["run", "start"][0].start_at_ns
    verdicts = {v.pose_seq: v for v in plain[vehicle, "verdict"] if v.sender == source.sender}
    received = [
        v for v in verdicts.values() if v.outcome == "delivered" and v.received_at_ns <= now
    ]
    newest = max(received, key=lambda v: v.measured_at_ns, default=None)
    assert source.number == (newest.pose_seq if newest else None)
    if newest:
        plane = LocalPlane(load_scenario("lane_change").origin)
        numbers = {v.pose_seq for v in received}
        places = [
            plane.to_plane(g.latitude_deg, g.longitude_deg, g.altitude_m)
            for g in sent if g.seq in numbers
        ]  # fmt: skip
        here = next(t for t in plain[vehicle, "truth"] if t.true_at_ns == now)
        left = brute_way_left(np.array(places), np.array([here.east_m, here.north_m]))
        assert source.age_s == pytest.approx((now - newest.measured_at_ns) / 1e9)
        assert source.received_at_s == pytest.approx((newest.received_at_ns - start) / 1e9)
        assert source.path_left_m == pytest.approx(left, abs=0.05)
    since = newest.pose_seq if newest else -1
    later = [g.seq for g in sent if g.sent_at_ns <= now and g.seq > since]
    assert [message.number for message in source.missing] == later
    for message in source.missing:
        fate = verdicts.get(message.number)
        if fate is None or fate.outcome != "dropped":
            assert message.fate == IN_TRANSIT
            assert fate is None or fate.received_at_ns > now
        else:
            known = CAUSES.get((source.sender, vehicle, fate.reason), "links.loss_ratio = 0.3")
            assert (message.fate, message.cause) == (fate.reason, known)
    due = [v for v in verdicts.values() if now - 10**9 < v.received_at_ns <= now]
    share = sum(v.outcome == "delivered" for v in due) / max(len(due), 1)
    assert source.received_ratio == (pytest.approx(share) if due else None)


def test_explanations_of_many_instants_match_the_log(log: Path, plain: Record) -> None:
    start, run, random = plain["run", "start"][0].start_at_ns, tables_of(log), Random(12)
    for _ in range(INSTANTS):
        vehicle, at_s = random.choice(list(SENDERS)), round(random.uniform(0.0, 11.9), 3)
        found, until = explanation(run, vehicle, at_s), start + round(at_s * 1e9)
        decision = [t for t in plain[vehicle, "tracking"] if t.decided_at_ns <= until][-1]
        assert found.decided_at_s == pytest.approx((decision.decided_at_ns - start) / 1e9)
        assert (found.mode, found.reason) == (decision.mode, decision.reason)
        assert [source.sender for source in found.sources] == SENDERS[vehicle]
        statuses = {"v1": decision.lead_status}
        for source in found.sources:
            check(plain, vehicle, source, decision.decided_at_ns)
            status = statuses.get(source.sender, decision.predecessor_status)
            assert source.status == ("" if vehicle == "v1" else status)
            assert source.sender in found.sentence


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
    assert "It " not in Explanation(
        vehicle="v4", decided_at_s=1.0, mode="composite", reason="", sources=(),
        acceleration_mps2=0.0, law_acceleration_mps2=-1.25,
    ).sentence  # fmt: skip


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
