"""Short sweeps: two vehicles, 0.8 s, in this process."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from scenarios.studies.many.cell_table import SweepTable
from scenarios.studies.many.files import run_sweep
from scenarios.studies.many.plan import SweepPlan, planned
from scenarios.studies.workers import open_workers

SETS = ("duration_s=0.8", "convoy.vehicles=2")
VARY = ("links.loss_ratio=0:0.8:0.8", "convoy.gap_m=3,10")
METRICS = ("cross_track_error_m_max", "true_gap_m_min")
LIMITS = ("lane", "error_m=0.02")
TABLES = ("sweep.csv", "runs.csv", "sweep.json")


def small_plan(vary: Sequence[str] = VARY, seeds: int = 2) -> SweepPlan:
    """A sweep of eight runs by default."""
    return planned("lane_change", vary=vary, seeds=seeds, sets=SETS, metrics=METRICS, limits=LIMITS)


def run_sweep_here(plan: SweepPlan, out: Path) -> SweepTable:
    return run_sweep(plan, out, partial(open_workers, 0), lambda _: None)[0]


def tables(out: Path) -> dict[str, bytes]:
    return {name: (out / name).read_bytes() for name in TABLES}
