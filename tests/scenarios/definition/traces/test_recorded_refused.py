"""Drives that cannot be driven: one clear line each."""

from functools import cache
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import scenario_from_text
from scenarios.definition.traces.drive import TraceError
from scenarios.definition.traces.reading import read_trace
from tests.made.examples import examples
from tests.made.scenarios.recorded_drives import (
    CSV,
    WRITERS,
    as_nmea,
    as_plane_csv,
    drive,
    driven,
    sentence,
)
from vehicles.geometry.geodesy import Origin

GPX = '<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1">{}</gpx>'

BROKEN: dict[str, tuple[str, bytes | None, str]] = {
    "missing file": ("a.csv", None, "no such file"),
    "empty file": ("a.csv", b"", "empty file"),
    "blank lines": ("a.csv", b"\n \n", "empty file"),
    "header only": ("a.csv", CSV.encode(), "no valid point"),
    "one point": ("a.csv", f"{CSV}1,2\n".encode(), "only one valid point, line 2"),
    "NaN only": ("a.csv", f"{CSV}nan,nan\nnan,nan\n".encode(), "line 2: x_m is 'nan'"),
    "infinite": ("a.csv", f"{CSV}inf,1\n-inf,1\n".encode(), "line 2: x_m is 'inf'"),
    "always one place": ("a.csv", (CSV + "5,5\n" * 9).encode(), "all 9 points lie within 0.00 m"),
    "a car that stands": (
        "a.csv",
        (CSV + "".join(f"{k % 3}e-2,{k % 5}e-2\n" for k in range(90))).encode(),
        "all 90 points lie within 0.0",
    ),
    "no usable columns after sep=": (
        "a.csv",
        b"sep=;\nfirst;second\n1;2\n",
        "given first, second",
    ),
    "two places far apart": (
        "a.csv",
        (CSV + "0,0\n1,0\n2,0\n" + "1,1201\n2,1201\n3,1201\n").encode(),
        "line 5: 1.2 km from the point before",
    ),
    "no usable columns": (
        "a.csv",
        b"first,second\n1,2\n",
        "given first, second",
    ),
    "no header": ("a.csv", b"1,2\n3,4\n", "no usable columns: given 1, 2"),
    "nowhere on earth": (
        "a.csv",
        b"latitude_deg,longitude_deg\n95,1\n96,1\n",
        "line 2: off the earth: 95, 1",
    ),
    "binary without zeros": ("a.csv", bytes(range(128, 256)) * 9, "no usable columns"),
    "broken log": ("a.mcap", b"\x89MCAP0\r\n" + b"\xff" * 40, "a.mcap: "),
    "cut GPX": ("a.gpx", GPX.encode()[:-3], "damaged XML at line 1"),
    "GPX without points": ("a.gpx", GPX.format("<trk></trk>").encode(), "no points in its tracks"),
    "GPX that is something else": ("a.gpx", b"<html></html>", "XML with root html"),
    "NMEA without a sentence": (
        "a.nmea",
        b"hello\nworld\n",
        "no valid GGA, RMC, GLL or GNS sentence",
    ),
    "NMEA with wrong checksums": (
        "a.nmea",
        as_nmea(drive()).replace(b",N,", b",S,"),
        "line 1: wrong or missing checksum",
    ),
    "NMEA without a fix": (
        "a.nmea",
        sentence("GNRMC,221400.00,V,,,,,,,141123,,,N").encode(),
        "no fix",
    ),
}


@pytest.mark.parametrize(("name", "content", "why"), BROKEN.values(), ids=BROKEN)
def test_a_broken_drive_is_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes | None, why: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    text = f'name = "a"\n[path]\nkind = "trace"\nfile = "{name}"\n'
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(text, label="a.toml", folder=tmp_path)
    (line,) = caught.value.lines
    assert line.startswith("a.toml: path.file: ")
    assert name in line
    assert why in line
    assert line.isprintable()


@cache
def written(name: str) -> bytes:
    return WRITERS[name](drive())


@examples(10, 60)
@given(
    name=st.sampled_from(sorted(WRITERS)),
    damage=st.lists(
        st.tuples(st.integers(0, 50_000), st.integers(0, 300), st.binary(max_size=12)),
        min_size=1,
        max_size=5,
    ),
)
def test_no_damage_to_a_file_gives_anything_but_a_drive_or_one_clear_line(
    tmp_path_factory: pytest.TempPathFactory, name: str, damage: list[tuple[int, int, bytes]]
) -> None:
    content = written(name)
    for at, removed, put in damage:
        at %= max(len(content), 1)  # noqa: PLW2901 - a place within the file
        content = content[:at] + put + content[at + removed :]
    path = tmp_path_factory.mktemp("damaged") / name
    path.write_bytes(content)
    lines: tuple[str, ...] = ("ok",)
    try:
        assert driven(path).duration_s > 0.0
    except ScenarioError as error:
        lines = error.lines
    (line,) = lines
    assert line.isprintable()
    assert len(line) < 400


def test_too_few_points_and_a_drive_that_does_not_close_are_refused(tmp_path: Path) -> None:
    (tmp_path / "few.csv").write_text(CSV + "0,0\n10,0\n20,0\n")
    (tmp_path / "open.csv").write_bytes(as_plane_csv(drive()))
    for name, keys, why in (
        ("few.csv", "", "points"),
        ("open.csv", "closed = true", "does not close"),
    ):
        with pytest.raises(ScenarioError, match=why) as caught:
            driven(tmp_path / name, keys)
        assert len(caught.value.lines) == 1
        assert name in caught.value.lines[0]


def test_a_drive_far_from_the_scenario_s_origin_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "drive.nmea"
    path.write_bytes(as_nmea(drive()))
    with pytest.raises(TraceError, match=r"line 1: latitude 48\.1.* further than 100 km"):
        read_trace(path, origin=Origin(30.0, -96.0, 0.0))
