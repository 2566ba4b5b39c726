"""GeoJSON: lines or points, their times, and broken files."""

import json
from typing import Any

import numpy as np
import pytest

from scenarios.definition.traces.drive import TraceError
from scenarios.definition.traces.formats.geojson import read_geojson

PLACES = [[13.1, 52.1, 1], [13.2, 52.2, 2], [13.3, 52.3, 3]]
STAMPS = [f"2026-03-29T12:00:0{k}Z" for k in range(3)]
LINE = {"type": "LineString", "coordinates": PLACES}


def feature(geometry: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties or None}


def collection(*features: Any) -> dict[str, Any]:
    return {"type": "FeatureCollection", "features": list(features)}


def at(place: list[float]) -> dict[str, Any]:
    return {"type": "Point", "coordinates": place}


@pytest.mark.parametrize(
    "content",
    [
        LINE,
        feature(LINE),
        collection(feature(LINE)),
        collection(feature(at([1, 2])), feature(LINE)),  # a line rather than points
        {"type": "MultiLineString", "coordinates": [PLACES[:1], PLACES[1:]]},
        collection(
            feature({"type": "LineString", "coordinates": PLACES[:2]}),
            feature(None),
            feature({"type": "LineString", "coordinates": PLACES[2:]}),
        ),
        {"type": "GeometryCollection", "geometries": [LINE]},
        collection(*(feature(at(place)) for place in PLACES)),
        {"type": "MultiPoint", "coordinates": PLACES},
        [feature(LINE)],
        {"locations": [feature(at(place)) for place in PLACES]},
    ],
)
def test_lines_or_else_points_are_read(content: Any) -> None:
    drive = read_geojson(json.dumps(content))
    assert drive.position.tolist() == [[52.1, 52.2, 52.3], [13.1, 13.2, 13.3]]
    assert drive.altitude_m.tolist() == [1, 2, 3]
    assert drive.clock is None


@pytest.mark.parametrize(
    "content",
    [
        feature(LINE, coordTimes=STAMPS),
        feature(LINE, coordinateProperties={"times": STAMPS}),
        feature({"type": "MultiLineString", "coordinates": [PLACES]}, coordTimes=[STAMPS]),
        feature(LINE, coordTimes=[1_774_785_600_000 + 1000 * k for k in range(3)]),
        collection(*(feature(at(p), time=t) for p, t in zip(PLACES, STAMPS, strict=True))),
        collection(*(feature(at(p), Timestamp=t) for p, t in zip(PLACES, STAMPS, strict=True))),
    ],
)
def test_times_are_read(content: Any) -> None:
    drive = read_geojson(json.dumps(content))
    assert (drive.time_s + drive.zero_s).tolist() == [1_774_785_600 + k for k in range(3)]
    assert drive.clock == "unix"


def test_unusable_positions_are_left_out() -> None:
    places = [PLACES[0], [None, 52], ["x", 52], 5, [{}, []], [10**400, 52], [13.2, 52.2, None]]
    drive = read_geojson(json.dumps({"type": "LineString", "coordinates": places}))
    assert drive.numbers.tolist() == [1, 7]
    assert np.isnan(drive.altitude_m[1])
    assert [r.number for r in drive.left_out.records] == [2, 3, 4, 5, 6]


@pytest.mark.parametrize("text", ["{", "[" * 50_000, "{'a': 1}", json.dumps(LINE)[:-9]])
def test_broken_json_is_refused_in_a_line(text: str) -> None:
    with pytest.raises(TraceError, match=r"^not valid JSON[^\n]*$"):
        read_geojson(text)


@pytest.mark.parametrize("text", ["{}", "[1]", json.dumps(collection()), '{"a": {"b": 1}}'])
def test_json_without_positions_is_refused(text: str) -> None:
    with pytest.raises(TraceError, match="no LineString"):
        read_geojson(text)
