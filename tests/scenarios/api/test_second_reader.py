"""Every column of three logs, one of them damaged, agrees with a reading by other libraries."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scenarios.api as convoy
from tests.made import second_reader
from tests.made.second_reader import MESSAGES, SecondReading, same
from transport import convoy_pb2

TABLES = ("gps", "trajectory", "tracking", "command", "verdict", "health")
UNKNOWN: tuple[object, ...] = (None, 0, False, "", [])
"""Values of fields that the log lacks; an unknown number may be NaN as well."""


@pytest.fixture(params=["new", "earlier version", "damaged"])
def both(logs: dict[str, Path], request: pytest.FixtureRequest) -> tuple[convoy.Run, SecondReading]:
    path = logs[request.param]
    reading = second_reader.read(path)
    assert reading.damaged == (request.param == "damaged")
    return convoy.open(path), reading


def fields(topic: str) -> Iterator[str]:
    names = getattr(convoy_pb2, MESSAGES[topic]).DESCRIPTOR.fields_by_name
    return (name for name in names if name != "vehicle")


def assert_column(column: Any, expected: list[Any], name: str) -> None:
    values = column.tolist()
    assert len(values) == len(expected), name
    for ours, theirs in zip(values, expected, strict=True):
        value = ours.tolist() if isinstance(ours, np.ndarray) else ours
        if theirs is None:
            assert value in UNKNOWN or math.isnan(value), name
        else:
            assert same(value, theirs), name


def test_every_field_of_every_message(both: tuple[convoy.Run, SecondReading]) -> None:
    run, reading = both
    seen = 0
    for vehicle, record in run.vehicles.items():
        for topic in ("true", *TABLES):
            source = "truth" if topic == "true" else topic
            if not reading.of(vehicle, source):
                assert source not in run.topics_of(vehicle)
                continue
            table = getattr(record, topic)
            for name in fields(source):
                assert_column(table[name], reading.values(vehicle, source, name), name)
                seen += 1
            start_at = reading.of("run", "start")[0].start_at_ns
            assert ((table.at_ns - start_at) / 1e9).tolist() == table.t_s.tolist()
    assert seen > 300
    texts = [text for name in (*run.vehicles, "run") for text in reading.of(name, "log")]
    assert sorted(run.texts.text) == sorted(text.text for text in texts)


def test_places_along_the_path_of_the_lead(both: tuple[convoy.Run, SecondReading]) -> None:
    run, reading = both
    lead, *followers = run.vehicles
    corners = positions(reading, lead)
    steps = np.diff(corners, axis=0)
    lengths = np.hypot(*steps.T)
    along = np.concatenate(([0.0], np.cumsum(lengths)))
    for name in followers:
        true = run.vehicles[name].true
        to_points = positions(reading, name)[:, None, :] - corners[None, :-1, :]
        shares = np.clip((to_points * steps).sum(axis=2) / lengths**2, 0.0, 1.0)
        distances = np.hypot(*np.moveaxis(to_points - shares[:, :, None] * steps, 2, 0))
        nearest = distances.argmin(axis=1)
        rows = np.arange(len(nearest))
        stations = along[nearest] + (shares * lengths)[rows, nearest]
        inside = (stations > 1.0) & (stations < along[-1] - 1.0) & np.isfinite(true.station_m)
        inside &= lengths[nearest] < 1.0  # the lead was recorded
        assert inside.sum() > 40
        ours, tolerance = true.station_m[inside], 5e-3 + 0.5 * bool(reading.damaged)
        assert ours == pytest.approx(stations[inside], abs=tolerance)
        offsets = distances[rows, nearest][inside]
        assert np.abs(true.error_m[inside]) == pytest.approx(offsets, abs=1e-3)


def positions(reading: SecondReading, vehicle: str) -> Any:
    """True positions (N, 2) of a vehicle."""
    return np.array([(pose.east_m, pose.north_m) for pose in reading.of(vehicle, "truth")])


def test_outcomes_of_all_messages(both: tuple[convoy.Run, SecondReading]) -> None:
    run, reading = both
    for (sender, receiver), link in run.links.items():
        rows = link.outcomes
        verdicts = {
            number: place
            for place, number in enumerate(reading.values(receiver, "verdict", "pose_seq"))
            if reading.of(receiver, "verdict")[place].sender == sender
        }
        sent_at = {pose.seq: pose.sent_at_ns for pose in reading.of(sender, "gps")}
        start_at = reading.of("run", "start")[0].start_at_ns
        assert ((rows.sent_at_ns - start_at) / 1e9).tolist() == rows.t_s.tolist()
        numbers = set(rows.number.tolist())
        assert numbers >= {*verdicts, *reading.values(sender, "gps", "seq")}
        assert len(numbers) == len(rows)
        columns = (rows.number, rows.sent_at_ns, rows.outcome, rows.cause, rows.delay_s)
        for number, at, outcome, cause, delay_s in zip(
            *(column.tolist() for column in columns), strict=True
        ):
            place = verdicts.get(number)
            if place is None:
                assert outcome in {"in_flight", "not_arrived", "unrecorded"}
                assert at == sent_at.get(number, at)
                assert math.isnan(delay_s)
                continue
            verdict = reading.of(receiver, "verdict")[place]
            assert (at, outcome) == (verdict.sent_at_ns, verdict.outcome)
            if outcome == "dropped":
                assert cause == verdict.reason
                assert math.isnan(delay_s)
            else:
                assert cause is None
                usable_at = second_reader.value(
                    verdict, "verdict", "received_at_ns" if verdict.late else "visible_at_ns"
                )
                assert delay_s == (usable_at - verdict.sent_at_ns) / 1e9
