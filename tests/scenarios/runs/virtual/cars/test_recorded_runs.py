"""Convoys behind drives as receivers record them, and behind two of them, to the end."""

import json
import re
import tomllib
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.definition.check.findings import report_of
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.studies.paper.drives import drive_trial, record_trial
from tests.made.scenarios.rough_drives import (
    CASES,
    FORMATS,
    SUFFIXES,
    SWEEP,
    UTM,
    Rough,
    scenario_of,
    text_of,
    truth,
)
from tests.system.logs import Run
from transport.log.reader import LogReader
from vehicles.messages import GpsPose, TruePose

WITHIN_M = 0.5
DRIVEN = (
    "hole of 50 m on an arc, nmea",
    "standing start, utm",
    "all of it",
    "utm",
    "jumps",
)


def convoy(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, list(map(str, arguments)))


@pytest.mark.campaign(1, len(DRIVEN))
def test_a_convoy_follows_a_rough_drive_to_its_end(tmp_path: Path, case: int) -> None:
    name = DRIVEN[case]
    file = tmp_path / "rough.toml"
    file.write_text(text_of(CASES[name][0], tmp_path, "[convoy]\nvehicles = 3\n"))
    done = convoy("run", file, "--clock", "virtual", "--quiet", "--out", tmp_path / "run")
    assert done.exit_code == 0, done.output
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["outcome"] == "completed"
    for row in summary["vehicles"][1:]:
        assert row["cross_track_error_m_max"] < WITHIN_M
        assert row["rejected_messages"] == 0
    # The run starts with the warnings of check.
    warnings = report_of(scenario_of(CASES[name][0], tmp_path)).warnings
    assert all(f"warning: {line}" in done.stderr for line in warnings if "drive." in line)


def test_the_log_of_a_run_has_the_offset_of_its_coordinates(tmp_path: Path) -> None:
    scenario = scenario_of(CASES["utm"][0], tmp_path, "duration_s = 2.0\n")
    record_trial(scenario, tmp_path / "run")
    log = LogReader(tmp_path / "run" / "run.mcap")
    path = tomllib.loads(log.attachments()["scenario.toml"].decode())["path"]
    truths = [m for _, _, m in log.messages(("truth",), ("v1",)) if isinstance(m, TruePose)]
    assert truths[-1].east_m + path["east_offset_m"] == pytest.approx(UTM[0], abs=30.0)
    assert truths[-1].north_m + path["north_offset_m"] == pytest.approx(UTM[1], abs=5.0)


# --- A recorded second drive as predecessor

LEAD = Rough(course=SWEEP, speed=15.0, form="gpx")


UPTIME = 1e6
"""Times of a receiver (s) that count from when it was switched on."""


def two_drives(
    folder: Path, lead: Rough = LEAD, later: float = 1.0, offset: str = "", own: str = ""
) -> str:
    """A scenario whose v2 is the lead's car again, `later` s behind it and with other noise."""
    second = [(t + later, e, n, v) for t, e, n, v in replace(lead, seed=2).points()]
    name = f"second.{SUFFIXES[lead.form]}"
    (folder / name).write_bytes(FORMATS[lead.form](second))
    text = text_of(lead, folder, f"duration_s = 30.0\n{own}")
    return f'{text}[vehicle.v2]\nreplay = "{name}"\n{offset}'


def with_two(folder: Path, *arguments: object, **more: object) -> Scenario:
    text = two_drives(folder, *arguments, **more)  # type: ignore[arg-type]
    return scenario_from_text(text, label="two.toml", folder=folder)


@pytest.mark.parametrize("form", ["gpx", "nmea"])
def test_a_replayed_vehicle_is_where_and_when_it_was_recorded(tmp_path: Path, form: str) -> None:
    lead = replace(LEAD, form=form)
    scenario = with_two(tmp_path, lead)
    assert scenario.replays["v2"].common
    run_in = scenario.route.run_in
    for seconds in np.arange(5.0, 28.0, 0.37).tolist():
        place, speed, _ = scenario.replays["v2"].at(seconds)
        distance = np.array([15.0 * (seconds - run_in - 1.0)])
        east, north = truth(SWEEP, distance)
        assert place.east == pytest.approx(float(east[0]), abs=0.05)
        assert place.north == pytest.approx(float(north[0]), abs=0.05)
        assert speed == pytest.approx(15.0, abs=0.15)


def test_followers_receive_a_replayed_vehicle_like_any_other(tmp_path: Path) -> None:
    scenario = with_two(tmp_path)
    assert report_of(scenario).warnings == ()
    to_lead = {("v2", "v1"), ("v3", "v1")}  # it repeats announced stops
    ahead = {("v1", "v3"), ("v2", "v3"), ("v1", "v4"), ("v3", "v4")}
    assert set(scenario.links) == ahead | to_lead
    trial = record_trial(scenario, tmp_path / "run")
    log = LogReader(tmp_path / "run" / "run.mcap")
    assert (log.counts["v2", "gps"], log.counts["v2", "truth"]) == (600, 1500)
    assert ("v2", "command") not in log.counts
    run = Run(tmp_path / "run")
    links = {(row["sender"], row["receiver"]): row for row in run.summary["links"]}
    assert links["v2", "v3"]["delivered"] >= 599
    assert run.summary["outcome"] == "completed"
    assert trial.drives[2].lateral_error.size == 1500
    for drive in trial.drives[2:]:
        assert drive.cross_track_max < WITHIN_M
    # It broadcasts what its receiver measures: noise about its true places.
    poses = [m for _, _, m in log.messages(("gps",), ("v2",)) if isinstance(m, GpsPose)]
    assert len({pose.latitude_deg for pose in poses}) == 600


def test_a_run_with_a_replay_is_in_its_log_and_the_same_again(tmp_path: Path) -> None:
    text = two_drives(tmp_path)
    scenario = scenario_from_text(text, overrides=["duration_s=8"], folder=tmp_path)
    again = scenario_from_text(scenario.text)  # without the files
    assert again.text == scenario.text
    one, other = drive_trial(scenario), drive_trial(again)
    for drive, before in zip(one.drives, other.drives, strict=True):
        assert np.array_equal(drive.east, before.east)


def test_without_common_times_both_drives_begin_together_and_the_offset_parts_them(
    tmp_path: Path,
) -> None:
    lead = replace(LEAD, form="csv", offset=UTM)
    together = with_two(tmp_path, lead, UPTIME)
    assert not together.replays["v2"].common
    (line,) = [line for line in report_of(together).warnings if line.startswith("v2")]
    assert re.fullmatch(
        r"v2: .* \d\.\d m (ahead of|behind) the lead at .* vehicle.v2.replay_offset_s\.",
        line,
    )
    apart = with_two(tmp_path, lead, UPTIME, offset="replay_offset_s = 1.0\n")
    assert [line for line in report_of(apart).warnings if line.startswith("v2")] == []
    (lag,) = {apart.replays["v2"].begun - together.replays["v2"].begun}
    assert lag == pytest.approx(-1.0)
    trial = drive_trial(apart)
    assert max(drive.cross_track_max for drive in trial.drives[2:]) < WITHIN_M


def test_check_names_the_setting_for_a_follower_ahead_of_a_replay(
    tmp_path: Path,
) -> None:
    early = with_two(tmp_path, LEAD, 3.0)
    (line,) = [line for line in report_of(early).warnings if "its follower" in line]
    remedy = re.search(r"Set (vehicle\.v3\.gap_m) to (\d+), or .* vehicle.v2.replay_offset_s", line)
    assert remedy is not None
    set_so = scenario_from_text(
        two_drives(tmp_path, LEAD, 3.0), overrides=[f"{remedy[1]}={remedy[2]}"], folder=tmp_path
    )
    assert not [line for line in report_of(set_so).warnings if "its follower" in line]
    place = set_so.route.start_station(2)
    second = set_so.replays["v2"].at(0.0)[0]
    ahead = (
        set_so.route.path.project(second.east, second.north, place, window=100.0).station - place
    )
    assert ahead == pytest.approx(early.route.spacings[2], abs=1.5)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (
            'duration_s = 39.5\n{}[vehicle.v2]\nreplay = "short.gpx"\n',
            "set duration_s to at most 1",
        ),
        ('{}[vehicle.v2]\nreplay = "no.gpx"\n', "no such file"),
        ('{}[vehicle.v1]\nreplay = "drive.gpx"\n', "given for the lead, whose drive is path.file"),
        ("{}[vehicle.v2]\nreplay_offset_s = 1.0\n", "given without replay"),
        ('{}[vehicle.v2]\nreplay = "plane.csv"\n', "allowed latitudes as drive.gpx has"),
        ('{}[vehicle.v2]\nreplay = "places.gpx"\n', "given without times"),
        ('{}[vehicle.v2]\nreplay = "far.gpx"\n', "closest point is .* km"),
    ],
)
def test_an_impossible_replay_is_refused_in_one_line(tmp_path: Path, text: str, why: str) -> None:
    points = LEAD.points()
    (tmp_path / "short.gpx").write_bytes(FORMATS["gpx"](points[:150]))
    (tmp_path / "plane.csv").write_bytes(FORMATS["csv"](points))
    (tmp_path / "far.gpx").write_bytes(
        FORMATS["gpx"]([(t, e + 20_000.0, n, v) for t, e, n, v in points])
    )
    places = re.sub(rb"<time>.*?</time>", b"", FORMATS["gpx"](points))
    (tmp_path / "places.gpx").write_bytes(places)
    with pytest.raises(ScenarioError, match=why) as caught:
        scenario_from_text(text.format(text_of(LEAD, tmp_path)), label="two.toml", folder=tmp_path)
    (line,) = caught.value.lines
    assert re.match(r"two\.toml: vehicle\.v[12]\.", line)


@pytest.mark.campaign(0, 1)
def test_every_rough_drive_is_driven_to_its_end(tmp_path: Path, case: int) -> None:  # noqa: ARG001
    for name, (rough, expected) in CASES.items():
        if not expected.refused:
            trial = drive_trial(scenario_of(rough, tmp_path, "[convoy]\nvehicles = 4\n"))
            assert max(one.cross_track_max for one in trial.drives[1:]) < WITHIN_M, name


def test_a_stop_is_replayed_as_one_and_never_backwards(tmp_path: Path) -> None:
    lead = Rough(course=SWEEP, speed=15.0, stands=((150.0, 5.0),), form="gpx")
    drive = with_two(tmp_path, lead).replays["v2"]
    found = [drive.at(0.05 * k) for k in range(700)]
    distances = [distance for _, _, distance in found]
    assert all(after >= before - 1e-9 for before, after in pairwise(distances))
    assert sum(speed < 0.1 for _, speed, _ in found) * 0.05 == pytest.approx(5.0, abs=0.7)
    assert min(speed for _, speed, _ in found) >= 0.0


def test_contradictions_are_reported_before_the_run(tmp_path: Path) -> None:
    late = report_of(with_two(tmp_path, LEAD, 3.0)).warnings
    assert any(re.match(r"v2: .* 1\d\.\d m behind v3, its follower", w) for w in late)
    early = report_of(with_two(tmp_path, LEAD, -2.0)).warnings
    assert any(re.match(r"v2: .* 3\d\.\d m ahead of the lead", w) for w in early)
