"""Convoys with few messages drive badly, but within physics, and events are reported."""

import json
from itertools import pairwise
from pathlib import Path

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.runs.observer import OnMessage
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from vehicles.car.tyres import GRAVITY, SLIDING_SHARE
from vehicles.messages import Command, LogText, Message, TruePose

LOSSES, GAPS, ALPHAS = (0.9, 0.6, 0.4, 0.2, 0.0), (1.0, 4.0, 10.0, 30.0), (0.0, 0.5, 1.0)
FUSIONS = ("composite", "predecessor", "blend")
"""Fusions; "predecessor" is the only lateral source of a composite trajectory."""
CASES = [
    (loss, gap, ALPHAS[(place + number) % 3], fusion)
    for number, (loss, gap) in enumerate((loss, gap) for loss in LOSSES for gap in GAPS)
    for place, fusion in enumerate(FUSIONS)
][:55]
FRICTION, STEERING_RATE, CONTROL_S = 0.9, 1.18, 0.02


@pytest.mark.campaign(1, 55)
def test_friction_and_steering_rate_are_kept_and_slides_and_departures_reported(
    case: int, tmp_path: Path
) -> None:
    loss, gap, alpha, fusion = CASES[case]
    requested = [
        "duration_s=16",
        *(f"links.loss_ratio={loss}", f"convoy.gap_m={gap}", f"control.alpha_ratio={alpha}"),
        "information_flow.lateral=predecessor"
        if fusion == "predecessor"
        else f"control.fusion={fusion}",
    ]
    results: list[Message] = []
    scenario = load_scenario("lane_change", requested)
    summary = run_virtual(
        scenario,
        tmp_path,
        Stop(),
        observers=[OnMessage(lambda _, message: results.append(message))],
    )
    reported = {message.text for message in results if isinstance(message, LogText)}
    for name in scenario.vehicle_names:
        poses = [one for one in results if isinstance(one, TruePose) and one.vehicle == name]
        assert max(abs(one.lateral_acceleration_mps2) for one in poses) <= FRICTION * GRAVITY + 1e-9
        assert max(one.friction_ratio for one in poses) <= 1.0 + 1e-9
        commands = [
            one.steering_rad for one in results if isinstance(one, Command) and one.vehicle == name
        ]
        steps = [abs(after - before) for before, after in pairwise([0.0, *commands])]
        assert max(steps) <= STEERING_RATE * CONTROL_S + 1e-12
        slid = any(one.friction_ratio >= SLIDING_SHARE for one in poses)
        events = {one.kind for one in summary.events if one.vehicles == (name,)}
        assert slid == ("slide" in events)
        (row,) = [one for one in summary.vehicles if one.name == name]
        assert (row.sliding_s or 0.0) > 0.0 if slid else row.sliding_s == 0.0
        if (row.cross_track_error_m_max or 0.0) > 1.0:  # half the lane is 1.75, half a car 0.93 m
            assert "lane_departure" in events
    assert {event.line for event in summary.events} <= reported
    assert set(summary.warnings) <= reported
    assert json.loads((tmp_path / "summary.json").read_text())["events"] or not summary.events
