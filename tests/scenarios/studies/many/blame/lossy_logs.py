"""Logs of short runs with losses of each kind."""

from pathlib import Path
from typing import Any

import tomli_w

from scenarios.definition.scenario import scenario_from_text
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from scenarios.studies.many.losses import RecordedRun, read_run

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
