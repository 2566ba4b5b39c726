"""`convoy run` from the command line to the log, with a process per vehicle over real Zenoh."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import pytest

from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from tests.made.scenarios.shipped import whole_run
from tests.system.conftest import DURATION_S, Driven
from tests.system.logs import (
    Run,
    assert_equal_while_nothing_was_late,
    assert_nothing_missing,
    assert_sound,
    assert_summary_is_in_the_log,
)
from tests.system.processes import Process, invoke, start

CONVOY = ("v1", "v2", "v3", "v4")
CROSS_TRACK_M_MAX = 0.5
FIRST_S = 3.0


def test_a_run_prints_progress_and_a_summary(lane_change: Driven) -> None:
    assert lane_change.exit_code == 0, lane_change.err
    assert f" of {DURATION_S} s" in lane_change.err  # progress
    for row in CONVOY:
        assert row in lane_change.out
    assert lane_change.out.rstrip().endswith(f" wall/{LOG_NAME}")
    assert {path.name for path in lane_change.wall.folder.iterdir()} == {
        LOG_NAME,
        SUMMARY_NAME,
    }


def test_no_message_is_missing(lane_change: Driven) -> None:
    assert_nothing_missing(lane_change.wall, DURATION_S)
    assert_nothing_missing(lane_change.virtual, DURATION_S)


def test_the_summary_matches_the_log(lane_change: Driven) -> None:
    assert_summary_is_in_the_log(lane_change.wall)
    summary = lane_change.wall.summary
    assert (summary["outcome"], summary["clock"]) == ("completed", "wall")
    assert all(row["finished"] for row in summary["vehicles"])
    assert summary["recorder_rejected_messages"] == {}
    for link in summary["links"]:
        judged = link["delivered"] + sum(link["dropped"].values())
        assert judged == link["judged"] <= link["sent"] == DURATION_S * 20
        assert link["loss_ratio"] == 0.0
    for row in summary["vehicles"][1:]:
        assert 0.0 < row["cross_track_error_m_max"] < CROSS_TRACK_M_MAX


def test_processes_drive_as_in_virtual_time(lane_change: Driven) -> None:
    wall, virtual = lane_change.wall, lane_change.virtual
    assert_equal_while_nothing_was_late(wall, virtual, within_m=0.02)
    assert max(abs(pose.steering_rad) for pose in wall.truths["v4"].values()) > 0.002  # v4 turned


@dataclass(frozen=True)
class ClockPair:
    """A whole virtual run of a scenario, and the first seconds of it by processes."""

    virtual: Run
    wall: Run
    wall_process: Process


def first_seconds(scenario: str) -> tuple[str, ...]:
    """Arguments of a run of the first seconds by processes, into folder `wall`."""
    return ("run", scenario, f"--set=duration_s={FIRST_S}", "--quiet", "--out=wall")


def assert_follows(pair: ClockPair) -> None:
    """Check that followers keep to the lead's path, and that both clocks agree."""
    rows = pair.virtual.summary["vehicles"]
    assert len(rows) == len(CONVOY)
    for row in rows[1:]:
        assert row["cross_track_error_m_max"] < CROSS_TRACK_M_MAX
        assert row["estimated_gap_m_min"] > 0.0
    assert_nothing_missing(pair.wall, FIRST_S)
    assert_equal_while_nothing_was_late(pair.wall, pair.virtual, within_m=0.02)


@pytest.mark.spread(1)
@pytest.mark.parametrize("scenario", ["church_lot", "highway"])
def test_recorded_drives_are_followed(
    scenario: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with start(*first_seconds(scenario), folder=tmp_path) as wall_process:
        virtual = Run(whole_run(scenario, tmp_path_factory))
        assert wall_process.wait() == 0, wall_process.err
    pair = ClockPair(virtual, Run(tmp_path / "wall"), wall_process)
    assert_follows(pair)
    assert_sound(pair.virtual.log)


def test_the_log_is_a_valid_mcap_file(lane_change: Driven) -> None:
    assert_sound(lane_change.wall.log)


def run_both_clocks(scenario: str, folder: Path) -> ClockPair:
    """Run a scenario on both clocks in parallel; both must succeed."""
    whole = ("run", scenario, "--clock=virtual", "--quiet", "--out=virtual")
    with start(*first_seconds(scenario), folder=folder) as wall_process:
        virtual = invoke(*whole, folder=folder)
        assert virtual.exit_code == 0, virtual.output
        assert wall_process.wait() == 0, wall_process.err
    return ClockPair(Run(folder / "virtual"), Run(folder / "wall"), wall_process)


def sentence(text: str) -> str:
    """An NMEA sentence with its checksum."""
    check = 0
    for letter in text:
        check ^= ord(letter)
    return f"${text}*{check:02X}"


def nmea_angle(degrees: float, width: int) -> str:
    """Degrees in the format of NMEA 0183: degrees and minutes in one number."""
    whole = int(degrees)
    return f"{whole:0{width}d}{(degrees - whole) * 60.0:010.7f}"


def nmea_drive(seconds: int, speed: float) -> list[str]:
    """GGA and RMC sentences at 10 Hz of a drive that swings by 3 m to either side."""
    metre_north = 1.0 / 111_132.0
    metre_east = metre_north / math.cos(math.radians(48.0))
    lines = []
    for k in range(10 * seconds):
        ahead = speed * k / 10.0
        left = 3.0 * (1.0 - math.cos(ahead / 25.0))
        latitude = nmea_angle(48.0 + left * metre_north, 2)
        longitude = nmea_angle(11.0 + ahead * metre_east, 3)
        position = f"{latitude},N,{longitude},E"
        clock = f"1200{k // 10:02d}.{k % 10}0"
        lines.append(sentence(f"GNGGA,{clock},{position},4,12,0.6,520.0,M,46.0,M,1.0,0001"))
        knots = speed / 0.514444
        lines.append(sentence(f"GNRMC,{clock},A,{position},{knots:.2f},90.0,211126,,,R"))
    return lines


def test_an_nmea_drive_is_followed_and_bad_lines_are_counted(tmp_path: Path) -> None:
    lines = nmea_drive(seconds=12, speed=12.0)
    lines[40] = lines[40][:-2] + "00"  # a failed checksum
    lines[80] = lines[80][:30]  # a cut sentence
    lines.insert(120, "\x7f rubbish from the cable")
    (tmp_path / "drive.nmea").write_text("\n".join(lines) + "\n")
    scenario = tmp_path / "mine.toml"
    scenario.write_text(
        'name = "mine"\n[path]\nkind = "trace"\nfile = "drive.nmea"\n'
        '[speed]\nlead = "recorded"\nfollowers = "gap"\n'
    )
    pair = run_both_clocks(scenario.name, tmp_path)
    assert_follows(pair)
    assert pair.virtual.truths["v4"][0].speed_mps == pytest.approx(12.0, abs=0.5)
    (line,) = [one for one in pair.wall_process.err.splitlines() if "left out" in one]
    assert re.match(r"warning: drive.nmea: 3 records are left out.*: line 41: .*; line 81: ", line)
