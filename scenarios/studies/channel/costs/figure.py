"""`convoy channel figure`: what loss, its bursts and latency cost the last vehicle of a convoy."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from scenarios.studies.channel.costs.drives import (
    SCENARIO,
    SETTINGS,
    Cost,
    Plan,
    driven,
    lane_margin_m,
)
from scenarios.studies.engine.engine import study_engine
from scenarios.studies.engine.fleet import fleet_of
from scenarios.studies.engine.results import refuse_existing, write_files

SCHEMA = "convoy.channel_figure/1"
PICTURE, TWIN = "channel.png", "channel.json"


def channel_figure(
    plan: Plan, out: Path, progress: Callable[[str], None], *, workers: int | None = None
) -> list[Cost]:
    """Drive `plan`, and write the picture and its figures as JSON into `out`.

    By default on all cores. Raises ScenarioError if one of both files is there already.
    """
    from scenarios.studies.channel.costs.cost_picture import drawn  # noqa: PLC0415 - matplotlib

    refuse_existing(out / PICTURE, out / TWIN, place="folder by --out")
    with study_engine(partial(fleet_of, workers), progress) as engine:
        costs = driven(plan, engine)
    margin_m = lane_margin_m()
    write_files(out, {TWIN: machine_readable(costs, margin_m), PICTURE: drawn(costs, margin_m)})
    return costs


def machine_readable(costs: Sequence[Cost], lane_margin_m: float) -> dict[str, Any]:
    """Give what the picture shows, and every single drive, as JSON has it."""
    return {
        "schema": SCHEMA,
        "scenario": SCENARIO,
        "settings": list(SETTINGS),
        "lane_margin_m": lane_margin_m,
        "channels": [
            {
                **asdict(one.channel),
                "seeds": list(range(1, len(one.errors_m) + 1)),
                "true_error_m_max": list(one.errors_m),
                "true_error_m_max_median": one.median_m,
                "true_error_m_max_largest": one.largest_m,
                "beyond_lane": one.beyond(lane_margin_m),
            }
            for one in costs
        ],
    }
