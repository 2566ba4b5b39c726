"""`convoy run` from the command line to the log, with a process per vehicle over real Zenoh."""

import math
from dataclasses import dataclass
from pathlib import Path

import pytest

from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.results.pictures.layouts import FOXGLOVE_NAME, RERUN_NAME
from tests.made.scenarios.shipped import driven_to_its_end
from tests.system.conftest import DURATION_S, Driven
from tests.system.logs import (
    Run,
    agreement,
    assert_equal_while_nothing_was_late,
    assert_nothing_missing,
    assert_sound,
    assert_summary_is_in_the_log,
)
from tests.system.processes import Process, run_to_the_end, start

CONVOY = ("v1", "v2", "v3", "v4")
BESIDE_THE_LEAD_S_PATH_M = 0.5
GLIMPSE_S = 3.0


def test_a_run_ends_as_planned_and_says_how_it_went(lane_change: Driven) -> None:
    assert lane_change.exit_code == 0, lane_change.err
    assert f" of {DURATION_S} s" in lane_change.err  # progress
    for row in CONVOY:
        assert row in lane_change.out
    assert lane_change.out.rstrip().endswith(f" wall/{LOG_NAME}")
    assert {path.name for path in lane_change.wall.folder.iterdir()} == {
        *(LOG_NAME, SUMMARY_NAME, FOXGLOVE_NAME, RERUN_NAME)
    }


def test_the_log_of_real_processes_is_a_sound_mcap_file(lane_change: Driven) -> None:
    assert_sound(lane_change.wall.log)


def test_no_message_is_missing(lane_change: Driven) -> None:
    assert_nothing_missing(lane_change.wall, DURATION_S)
    assert_nothing_missing(lane_change.virtual, DURATION_S)


def test_the_summary_is_what_the_log_holds(lane_change: Driven) -> None:
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
        assert 0.0 < row["cross_track_error_m_max"] < BESIDE_THE_LEAD_S_PATH_M


def test_processes_drive_as_virtual_time_does(lane_change: Driven) -> None:
    wall, virtual = lane_change.wall, lane_change.virtual
    assert_equal_while_nothing_was_late(wall, virtual, within_m=0.02)
    assert max(abs(pose.steering_rad) for pose in wall.truths["v4"].values()) > 0.002  # it turned


@dataclass(frozen=True)
class Glimpse:
    """A scenario driven to its end in virtual time, and by processes for its first seconds."""

    virtual: Run
    wall: Run
    said: Process


def beginning(scenario: str) -> tuple[str, ...]:
    """Arguments that let processes drive the first seconds of a scenario into folder `wall`."""
    how = "--start=spawn" if scenario == "highway" else "--start=fork"
    return ("run", scenario, f"--set=duration_s={GLIMPSE_S}", "--quiet", "--out=wall", how)


def glimpse(scenario: str, folder: Path) -> Glimpse:
    """Run a scenario both ways at once; both must end well."""
    whole = ("run", scenario, "--clock=virtual", "--quiet", "--out=virtual")
    with start(*beginning(scenario), folder=folder) as said:
        virtual = run_to_the_end(*whole, folder=folder)
        assert virtual.exit_code == 0, virtual.err
        assert said.wait() == 0, said.err
    return Glimpse(Run(folder / "virtual"), Run(folder / "wall"), said)


def assert_follows(seen: Glimpse) -> None:
    """Followers stay beside the lead's path to the end, and processes drive like virtual time."""
    rows = seen.virtual.summary["vehicles"]
    assert len(rows) == len(CONVOY)
    for row in rows[1:]:
        assert row["cross_track_error_m_max"] < BESIDE_THE_LEAD_S_PATH_M
        assert row["estimated_gap_m_min"] > 0.0
    assert_nothing_missing(seen.wall, GLIMPSE_S)
    assert_equal_while_nothing_was_late(seen.wall, seen.virtual, within_m=0.02)


@pytest.mark.spread(1)
@pytest.mark.parametrize("scenario", ["church_lot", "highway"])
def test_recorded_drives_are_followed(
    scenario: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with start(*beginning(scenario), folder=tmp_path) as said:
        virtual = Run(driven_to_its_end(scenario, tmp_path_factory))
        assert said.wait() == 0, said.err
    seen = Glimpse(virtual, Run(tmp_path / "wall"), said)
    assert_follows(seen)
    assert_sound(seen.virtual.log)


def sentence(text: str) -> str:
    """Return an NMEA sentence with its checksum."""
    check = 0
    for letter in text:
        check ^= ord(letter)
    return f"${text}*{check:02X}"


def dm(degrees: float, width: int) -> str:
    """Write degrees the way of NMEA 0183: degrees and minutes in one number."""
    whole = int(degrees)
    return f"{whole:0{width}d}{(degrees - whole) * 60.0:010.7f}"


def nmea_drive(seconds: int, speed: float) -> list[str]:
    """GGA and RMC sentences, ten a second, of a drive that swings from side to side by 3 m."""
    metre_north = 1.0 / 111_132.0
    metre_east = metre_north / math.cos(math.radians(48.0))
    lines = []
    for k in range(10 * seconds):
        ahead = speed * k / 10.0
        aside = 3.0 * (1.0 - math.cos(ahead / 25.0))
        place = f"{dm(48.0 + aside * metre_north, 2)},N,{dm(11.0 + ahead * metre_east, 3)},E"
        clock = f"1200{k // 10:02d}.{k % 10}0"
        lines.append(sentence(f"GNGGA,{clock},{place},4,12,0.6,520.0,M,46.0,M,1.0,0001"))
        knots = speed / 0.514444
        lines.append(sentence(f"GNRMC,{clock},A,{place},{knots:.2f},90.0,211126,,,R"))
    return lines


def test_a_receiver_s_output_is_followed_and_bad_lines_are_counted(tmp_path: Path) -> None:
    lines = nmea_drive(seconds=20, speed=12.0)
    lines[40] = lines[40][:-2] + "00"  # a failed checksum
    lines[80] = lines[80][:30]  # a cut sentence
    lines.insert(120, "\x7f rubbish from the cable")
    (tmp_path / "drive.nmea").write_text("\n".join(lines) + "\n")
    scenario = tmp_path / "mine.toml"
    scenario.write_text(
        'name = "mine"\n[path]\nkind = "trace"\nfile = "drive.nmea"\n'
        '[speed]\nlead = "recorded"\nfollowers = "gap"\n'
    )
    seen = glimpse(scenario.name, tmp_path)
    assert_follows(seen)
    assert seen.virtual.truths["v4"][0].speed_mps == pytest.approx(12.0, abs=0.5)
    assert [line for line in seen.said.err.splitlines() if "bad line" in line] == [
        "warning: drive.nmea: 3 bad lines skipped, the first is line 41: wrong or missing checksum"
    ]


def test_another_seed_drives_otherwise(lane_change: Driven, tmp_path: Path) -> None:
    again = run_to_the_end(
        *("run", "lane_change", "--set=duration_s=2", "--seed=2", "--clock=virtual", "--quiet"),
        *("--out", "other"),
        folder=tmp_path,
    )
    assert again.exit_code == 0, again.err
    found = agreement(Run(tmp_path / "other"), lane_change.virtual)
    assert found.equal < found.compared / 10
