"""The table of `convoy check`."""

import json
import re

import pytest
from click.testing import CliRunner

from scenarios.cli.main import cli
from scenarios.definition.scenario import library

SETTINGS = {
    "links.loss_ratio=0.2": ("links", "loss 0.2"),
    "links.latency_ms=70": ("links", "70 ms"),
    "links.jitter_ms=11": ("links", "jitter 11 ms"),
    "links.preset=bursty": ("links", "bursty, 20 ms, .*; Gilbert–Elliott: loss 0.2, 8 messages"),
    "vehicle.v2.receiver_off=[{from_s=1.0,to_s=2.0}]": ("links", "receiver off from 1 to 2 s: v1"),
    "links.rate_hz=7": ("links", "carries up to 7 Hz"),
    'link=[{sender="v1",receiver="v3",loss_ratio=0.3}]': ("links", "loss 0.3, .*: v1 → v3"),
    "gnss.rate_hz=5": ("GNSS", "5 Hz"),
    "vehicle.v3.gnss.position_noise_m=0.5": ("GNSS", "0.5 m, .*: v3"),
    "gnss.preset=rtk_float": ("GNSS", r"rtk_float \(float\); drift 0.19 m over 100 s"),
    "gnss.common_drift.deviation_m=2": ("GNSS", "common drift 2 m"),
    "gnss.bias.east_m=0.3": ("GNSS", "bias 0.3 m east"),
    "gnss.latency_ms=80": ("GNSS", "80 ms"),
    "gnss.quantisation_m=0.1": ("GNSS", "steps of 0.1 m"),
    "gnss.accuracy_ratio=0.05": ("GNSS", "0.05 of its deviation"),
    "gnss.outages=[{kind='time',from_s=1,to_s=2}]": ("GNSS", "1 outages"),
    "vehicle.v3.gnss.fix=single": ("GNSS", r"fix \(single\).*: v3"),
    "sending.kind=cam": ("sending", "CAM, checked every 100 ms, phase 0 s"),
    "sending={kind='fixed',rate_hz=7,drawn_phase=true}": ("sending", "7 Hz, random phase"),
    "sending={kind='intervals',table='cam_vw_highway'}": ("sending", "cam_vw_highway"),
    "sending={kind='profile',profile=[{at_s=3,rate_hz=2}]}": ("sending", "2 Hz from 3 s"),
    "vehicle.v3.sending={kind='cam',dcc={busy=[{at_s=0,busy_ratio=1}]}}": (
        "sending", "CAM, .*; congestion control: v3",
    ),
    "control.controller=stanley": ("controller", "stanley"),
    "control.gains.heading_rad_per_rad=0.7": ("controller", "0.06, 0.7, 0.08"),
    "control.knows_loading=true": ("controller", "knows the load"),
    "control.own_state=exact": ("own state", "exact"),
    "vehicle.v3.control.own_state=exact": ("own state", "exact: v3"),
    "imu.rate_hz=100": ("own state", "inertial sensor at 100 Hz"),
    "vehicle.v3.imu.yaw_rate_bias_radps=0.5": ("own state", "0.5 rad/s: v3"),
    "vehicle.v3.gap_sensor={range_m=80,rate_hz=25}": ("gap sensor", "80 m .* 25 Hz, .*: v3"),
    "control.rate_hz=40": ("control", "at 40 Hz"),
    "control.fusion=blend": ("fusion", "blend"),
    "control.trajectory=paper": ("fusion", "paper trajectory"),
    "vehicle.v3.control.trajectory=paper_prefix": ("fusion", "paper_prefix trajectory, .*: v3"),
    "control.alpha_ratio=0.9": ("fusion", "α 0.9"),
    "vehicle.v3.control.alpha_ratio=0.8": ("fusion", "α 0.8, .*: v3"),
    "control.alpha_ratio=0.3": ("largest α", r"0.6834 at 30.0 m/s, .*α 0.3 is below it:"),
    "control.alpha_ratio=0.7": ("largest α", r"\(17.7 rad/s\). α 0.7 is above it: errors at 17.7"),
    "control.preview_s=1.1": ("fusion", "preview 1.1 s"),
    "speed.followers=gap": ("followers drive", r"3 m \+ 0.5 s · speed; acceleration up to 2,"),
    "vehicle.v3.control={longitudinal={use='ploeg',gap_gain_per_s2=0.3}}": (
        "longitudinal law",
        "ploeg .*gap_gain_per_s2 0.3.*: v3",
    ),
    "vehicle.v2.lateral_offset_m=0.4": ("start off the path", "v2: 0.4 m left"),
    "convoy.on_vehicle_failure=continue": ("on vehicle failure", "continue"),
    "convoy.clock_uncertainty_ms_max=9": ("clocks", "within 9 ms"),
    "events.lane_width_m=3.1": ("lane", "3.1 m"),
    "events.near_miss_gap_m=0.7": ("near miss", "0.7 m"),
    "events.near_miss_time_s=0.8": ("near miss", "0.8 s"),
    "events.path_lost_s=0.6": ("path lost", "no known path for 0.6 s"),
    "limits.collisions_max=2": ("limits that fail the run", "collisions_max = 2"),
    'limits.modes=[{vehicle="v3", mode="lead", after_s=7.0, within_s=0.6}]': (
        "limits that fail the run",
        "v3 lead within 0.6 s after 7 s",
    ),
    'limits.sources=[{vehicle="v3", source="v2", status="lost", within_s=0.6}]': (
        "limits that fail the run",
        "v3 lost of v2 within 0.6 s after 0 s",
    ),
    'limits.recovery=[{vehicle="v3", error_m=0.3, after_s=7.0, within_s=0.6}]': (
        "limits that fail the run",
        "v3 within 0.3 m within 0.6 s after 7 s",
    ),
    "limits.after_collision=continue": ("limits that fail the run", "after_collision = continue"),
    "control.estimate_slip=true": ("controller", "learns the load"),
    "parameters.tyres=linear": ("tyres", "linear; steering rate up to 1.18 rad/s"),
    "parameters.friction_ratio=0.4": ("tyres", "brush, friction 0.4"),
    "parameters.steering_rate_limit_radps=inf": ("tyres", "no limit of the steering rate"),
    "loading.rear_passengers=0": ("mass", "2016 kg with driver and load"),
}  # fmt: skip
"""Settings, and the row that each changes."""


def checked(*arguments: str) -> str:
    result = CliRunner().invoke(cli, ["check", *arguments], env={"COLUMNS": "80"})
    assert result.exit_code == 0, result.output
    return result.stdout


def rows(text: str) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for line in text.splitlines()[1:]:
        what, figure = line[:26].strip(), line[26:].strip()
        if what or not found:
            found.append((what, figure))
        else:
            found[-1] = found[-1][0], f"{found[-1][1]} {figure}"
    return found


@pytest.mark.parametrize("setting", SETTINGS)
def test_a_setting_is_printed_in_its_row(setting: str) -> None:
    what, expected = SETTINGS[setting]
    name = "highway" if "longitudinal" in setting else "lane_change"
    found = rows(checked(name, "--set", setting))
    values = [figure for row, figure in found if row == what]
    assert any(re.search(expected, figure) for figure in values), found


@pytest.mark.parametrize("name", library())
def test_no_line_is_empty_or_wider_than_a_terminal(name: str) -> None:
    lines = checked(name).splitlines()
    assert all(line.strip() for line in lines)
    assert max(map(len, lines)) <= 80 or lines[-1].startswith("warning: ")


def test_json_has_the_same_figures() -> None:
    figures = json.loads(checked("church_lot", "--json", "--set", "limits.near_misses_max=3"))
    assert figures["gap_policy"]["standstill_m"] == 2.0
    assert figures["control"]["v4"]["controller"] == "slip_compensated"
    assert figures["gnss"]["v1"]["rate_hz"] == 20.0
    assert figures["limits"]["near_misses_max"] == 3
    assert figures["events"]["path_lost_s"] == 1.0
