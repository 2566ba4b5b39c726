"""Drives whose clock or speed sensor was wrong for a while are driven as if it had been right."""

import tracemalloc
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.check.findings import report_of
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.traces.disorder import LEAP

COUNT, INTERVAL, SPEED = 80, 0.5, 10.0
UNIX = 1_774_746_000.0
WEEKS_1024 = 1024 * 7 * 86_400.0
MOST_BYTES = 100_000_000

Places = list[tuple[float, float]]


def course() -> Places:
    """A straight, then a left turn of radius 100 m, at a constant speed."""
    places = []
    for k in range(COUNT):
        s = k * INTERVAL * SPEED
        turn = max(0.0, s - 150.0) / 100.0
        places.append((min(s, 150.0) + 100.0 * np.sin(turn), 100.0 * (1.0 - np.cos(turn))))
    return places


def times(zero: float = UNIX) -> list[float]:
    return [zero + k * INTERVAL for k in range(COUNT)]


def csv(times: Sequence[float], speeds: Sequence[float] = ()) -> str:
    columns = [f"{t!r},{x:.4f},{y:.4f}" for t, (x, y) in zip(times, course(), strict=True)]
    if not speeds:
        return "\n".join(["t_s,x_m,y_m", *columns])
    rows = [f"{row},{speed}" for row, speed in zip(columns, speeds, strict=True)]
    return "\n".join(["t_s,x_m,y_m,speed_mps", *rows])


def degrees() -> Places:
    return [(50.0 + y / 111_229.0, 8.0 + x / 71_695.0) for x, y in course()]


def gpx(times: Sequence[float]) -> str:
    points = "".join(
        f'<trkpt lat="{latitude:.8f}" lon="{longitude:.8f}">'
        f"<time>{datetime.fromtimestamp(at, UTC).isoformat().replace('+00:00', 'Z')}</time></trkpt>"
        for at, (latitude, longitude) in zip(times, degrees(), strict=True)
    )
    return f'<gpx version="1.1" creator="test"><trk><trkseg>{points}</trkseg></trk></gpx>'


def nmea(knots: float) -> str:
    lines = []
    for k, (latitude, longitude) in enumerate(degrees()):
        at = k * INTERVAL
        fields = (
            f"GNRMC,12{int(at // 60):02d}{at % 60:05.2f},A,{int(latitude):02d}"
            f"{latitude % 1 * 60:09.6f},N,{int(longitude):03d}{longitude % 1 * 60:09.6f},E,"
            f"{knots:.3f},90.0,290326,,,A"
        )
        check = 0
        for byte in fields.encode():
            check ^= byte
        lines.append(f"${fields}*{check:02X}")
    return "\n".join(lines)


def load(folder: Path, name: str, text: str, lead: str = "recorded") -> Scenario:
    (folder / name).write_text(text, encoding="utf-8")
    scenario = folder / f"{name}.toml"
    scenario.write_text(
        f'name = "drive"\n[path]\nkind = "trace"\nfile = "{name}"\n[speed]\nlead = "{lead}"\n'
    )
    return load_scenario(str(scenario), ())


def assert_driven_alike(scenario: Scenario, other: Scenario, *, left_out: int) -> None:
    """Both leads move alike, once the points that one of them lacks at its start are passed."""
    span = (COUNT - 1 - left_out) * INTERVAL
    assert scenario.duration_s == pytest.approx(span, abs=3.0)
    way = other.route.length - left_out * INTERVAL * SPEED
    assert scenario.route.length == pytest.approx(way, abs=1.0)
    for at in np.arange(1.0, span - 1.0, 0.5).tolist():
        speed = scenario.route.profile.at(at)[0]
        assert speed == pytest.approx(other.route.profile.at(at)[0], abs=0.1)


LEAPS = {
    "1970 before the fix": [k * INTERVAL for k in range(5)],
    "week rollover before the fix": [UNIX - WEEKS_1024 + k * INTERVAL for k in range(5)],
    "the future before the fix": [UNIX + WEEKS_1024 + k * INTERVAL for k in range(5)],
}


@pytest.mark.parametrize("first", LEAPS.values(), ids=LEAPS)
@pytest.mark.parametrize("form", ["csv", "gpx"])
def test_records_before_the_fix_are_left_out(tmp_path: Path, form: str, first: list[float]) -> None:
    write = csv if form == "csv" else gpx
    good = load(tmp_path, f"good.{form}", write(times()))
    tracemalloc.start()
    scenario = load(tmp_path, f"leaps.{form}", write([*first, *times()[len(first) :]]))
    assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    tracemalloc.stop()
    assert_driven_alike(scenario, good, left_out=len(first))
    report = report_of(scenario)
    assert (report.skipped_lines, len(report.warnings)) == (
        len(first),
        len(report_of(good).warnings) + 1,
    )


def test_epochs_in_milliseconds_after_small_times_need_no_memory(tmp_path: Path) -> None:
    mixed = [*times(0.0)[:5], *(1000.0 * at for at in times()[5:])]
    tracemalloc.start()
    scenario = load(tmp_path, "ms.csv", csv(mixed), lead="set")
    assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    tracemalloc.stop()
    assert report_of(scenario).skipped_lines == 5


@pytest.mark.parametrize("off", [-UNIX, 2.0 * LEAP, -2.0 * LEAP])
@pytest.mark.parametrize("number", [0, 30, COUNT - 1])
def test_a_single_record_of_another_time_is_left_out(
    tmp_path: Path, number: int, off: float
) -> None:
    wrong = times()
    wrong[number] += off
    scenario = load(tmp_path, "single.csv", csv(wrong))
    assert report_of(scenario).skipped_lines == 1
    profile = scenario.route.profile
    assert [profile.at(at)[0] for at in (5.0, 15.0, 30.0)] == pytest.approx([SPEED] * 3, abs=0.1)


@pytest.mark.parametrize("interval", [0.2, INTERVAL, 3.0])
@pytest.mark.parametrize("first", [1, 40])
def test_records_of_another_time_among_others_are_interpolated(
    tmp_path: Path, first: int, interval: float
) -> None:
    wrong = times()
    wrong[first : first + 3] = [k * interval for k in range(3)]
    scenario = load(tmp_path, "three.csv", csv(wrong))
    assert (report_of(scenario).skipped_lines, report_of(scenario).points) == (3, COUNT)
    profile = scenario.route.profile
    assert [profile.at(at)[0] for at in (3.0, 15.0, 30.0)] == pytest.approx([SPEED] * 3, abs=0.1)


def test_a_drive_of_several_days_is_kept_whole_and_has_no_recorded_speed(tmp_path: Path) -> None:
    days = [at + (0.0 if k < COUNT // 2 else 3.0 * LEAP) for k, at in enumerate(times())]
    scenario = load(tmp_path, "days.csv", csv(days), lead="set")
    assert report_of(scenario).skipped_lines == 0
    with pytest.raises(ScenarioError, match="allowed at most"):
        load(tmp_path, "days.csv", csv(days))


@pytest.mark.parametrize("form", ["csv", "nmea"])
def test_speeds_that_are_all_zero_are_derived_from_the_times(tmp_path: Path, form: str) -> None:
    if form == "csv":
        texts = csv(times()), csv(times(), [0.0] * COUNT)
    else:
        texts = nmea(SPEED / 0.514444), nmea(0.0)
    good, zero = (
        load(tmp_path, f"{name}.{form}", text)
        for name, text in zip(("good", "zero"), texts, strict=True)
    )
    assert_driven_alike(zero, good, left_out=0)
    assert len(report_of(zero).warnings) == len(report_of(good).warnings) + 1


def test_speeds_that_do_not_fit_the_points_are_derived_from_the_times(tmp_path: Path) -> None:
    scenario = load(tmp_path, "one.csv", csv(times(), [0.0] * (COUNT - 1) + [10.0]))
    assert scenario.route.profile.at(20.0)[0] == pytest.approx(SPEED, abs=0.1)


def test_a_jump_casts_no_doubt_on_recorded_speeds(tmp_path: Path) -> None:
    rows = csv(times(), [SPEED] * COUNT).splitlines()
    rows[40] = f"{times()[39]!r},1000,0,{SPEED}"
    warnings = report_of(load(tmp_path, "jump.csv", "\n".join(rows))).warnings
    assert [text.partition(": ")[2][:20] for text in warnings if "jump.csv" in text] == [
        "1 record is left out"
    ]


def test_absurdly_fast_times_are_doubted(tmp_path: Path) -> None:
    minutes = [k * INTERVAL / 60.0 for k in range(COUNT)]
    warnings = report_of(load(tmp_path, "min.csv", csv(minutes))).warnings
    assert sum("6e+02 m/s" in text for text in warnings) == 1


def test_points_with_zero_speeds_in_a_scenario_are_refused_in_one_line(tmp_path: Path) -> None:
    lines = ", ".join(f"{x:.3f}" for x, _ in course()), ", ".join(f"{y:.3f}" for _, y in course())
    scenario = tmp_path / "inline.toml"
    scenario.write_text(
        'name = "inline"\n[speed]\nlead = "recorded"\n[path]\nkind = "points"\n'
        f"east_m = [{lines[0]}]\nnorth_m = [{lines[1]}]\n"
        f"time_s = {times(0.0)}\nspeed_mps = {[0.0] * COUNT}\n"
    )
    with pytest.raises(ScenarioError, match=r"0\.00 times what its points need"):
        load_scenario(str(scenario), ())
