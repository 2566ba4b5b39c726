"""A run with exactly the losses that one says: those of its log give its log, others only these."""

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.runs.rehearsal import overhear
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from scenarios.studies.many.blame.imposed import loss_free
from scenarios.studies.many.blame.losses import LostMessage, RecordedRun, read_run
from scenarios.studies.many.blame.rerun import EVER, BlameQuestion, drive
from scenarios.studies.many.limit import Limit
from vehicles.messages import LinkVerdict, Message

QUESTION = BlameQuestion(figure="error", limit=Limit("lane"))
DELAYED = {"latency_ms": 40.0, "jitter_ms": 90.0}
LAWS: dict[str, dict[str, Any]] = {
    "independent": {"links": {"loss_ratio": 0.3, **DELAYED}},
    "in bursts, in order": {
        "links": {
            "loss": {"kind": "gilbert_elliott", "loss_ratio": 0.3, "burst_messages_mean": 4.0},
            "delay": {"kind": "gamma", "mean_ms": 30.0, "deviation_ms": 20.0, "order": "in_order"},
        }
    },
    "by place, rate and reservation": {
        "links": {
            "rate_hz": 7.0,
            "radio": {"kind": "table", "distance_m": [10.0, 60.0], "delivery_ratio": [0.9, 0.4]},
            "collisions": {"loss_ratio": 0.2},
        }
    },
    "a preset": {"links": {"preset": "bursty"}},
    "outages and radios off": {
        "links": {"outages": [{"kind": "window", "from_s": 0.5, "to_s": 0.9}], **DELAYED},
        "vehicle": {"v2": {"transmitter_off": [{"from_s": 1.0, "to_s": 1.3}]}},
    },
    "a queue": {"links": {"queue": {"bytes_per_s": 1300.0, "depth_messages": 3}, **DELAYED}},
    "changes": {
        "links": {"loss_ratio": 0.1, **DELAYED},
        "change": [
            {"kind": "cut", "sender": "v1", "receiver": "v3", "at_s": 0.7, "for_s": 0.4},
            {"kind": "link", "sender": "*", "receiver": "v2", "at_s": 1.0, "latency_ms": 150.0},
        ],
    },
    "wrong bits and copies": {
        "links": {"content": {"bit_error_ratio": 3e-4, "duplicate_ratio": 0.2}, **DELAYED}
    },
}


def recorded(law: str, folder: Path) -> RecordedRun:
    text = {"extends": "lane_change", "duration_s": 1.5, "convoy": {"vehicles": 3}} | LAWS[law]
    run_virtual(scenario_from_text(tomli_w.dumps(text)), folder, Stop())
    return read_run(folder / "run.mcap")


def fates(scenario: Scenario) -> dict[tuple[str, str, int], tuple[str, int]]:
    """Of each message that a link judged why it was dropped, and when it was visible (ns)."""
    found = {}

    def listen(message: Message) -> None:
        if isinstance(message, LinkVerdict):
            key = message.sender, message.vehicle, message.pose_seq
            found[key] = message.reason, message.visible_at_ns

    overhear(scenario, listen)
    return found


@pytest.mark.parametrize("law", LAWS)
def test_the_log_s_losses_give_the_log_s_poses_and_fewer_only_what_was_given_back(
    law: str, tmp_path: Path
) -> None:
    run = recorded(law, tmp_path)
    lost = run.lost(EVER)
    assert lost
    convoy = loss_free(run)
    assert drive(convoy.losing(lost), QUESTION, whole=True).truth == run.truth

    still_lost, given_back = lost[::2], lost[1::2]
    before, after = fates(convoy.losing(lost)), fates(convoy.losing(still_lost))
    back = {(*one.link, one.number) for one in given_back}
    for key, (reason, visible_at) in before.items():
        if law == "in bursts, in order":  # what comes back holds up what was sent after it
            assert after[key][1] >= visible_at
        else:
            assert after[key][1] == visible_at
        assert after[key][0] == ("" if key in back else reason)


def test_without_losses_nothing_is_lost_and_with_one_it_alone(tmp_path: Path) -> None:
    run = recorded("by place, rate and reservation", tmp_path)
    convoy = loss_free(run)
    kept = {key for key, (reason, _) in fates(convoy.scenario).items() if not reason}
    assert {number for *_, number in kept} < set(range(31))  # the link's own rate stays
    alone = LostMessage(
        sent_at=0, link=("v1", "v2"), number=min(n for _, r, n in kept if r == "v2")
    )
    left = {key for key, (reason, _) in fates(convoy.losing([alone])).items() if not reason}
    assert kept - left == {("v1", "v2", alone.number)}


@pytest.mark.parametrize("law", ["independent", "a queue"])
def test_the_scenario_written_is_the_one_that_was_driven(law: str, tmp_path: Path) -> None:
    run = recorded(law, tmp_path)
    smallest = loss_free(run).smallest(run.lost(EVER), Limit("error_m", 0.25), "some losses")
    again = scenario_from_text(smallest.text)
    assert again.text == smallest.text
    assert again.tables.limits.cross_track_error_m_max == 0.25
    assert drive(again, QUESTION, whole=True).truth == run.truth
