"""Tables of sweeps agree with their runs, and for any order of the journal."""

import csv
import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.studies.job import write_files
from scenarios.studies.many.cell_table import table_of, tables_of
from scenarios.studies.many.plan import SweepPlan
from scenarios.studies.many.variant import agresti_coull
from tests.made.many.small_sweeps import TABLES, small_plan

SEEDS = 7


@pytest.fixture(scope="module")
def plan() -> SweepPlan:
    return small_plan(seeds=SEEDS)


def journal_entries(plan: SweepPlan) -> dict[str, Any]:
    noise = random.Random(5)
    entries: dict[str, Any] = {}
    for place in range(len(plan.cells)):
        for seed in range(1, SEEDS + 1):
            error = 0.01 * place + noise.random()
            figures = [error, None if seed % 2 else 10.0 - error]
            broken = [error > 1.0, error > 0.5]
            outcome = "failed" if error > 0.9 else "completed"
            entries[f"{place}/{seed}"] = {
                "outcome": outcome, "reason": "", "figures": figures, "broken": broken,
            }  # fmt: skip
    entries["1/3"] = {"error": "ValueError: bad, really"}
    entries |= {f"2/{seed}": {"error": "bad"} for seed in range(1, SEEDS + 1)}
    return entries


def values(entries: dict[str, Any], cell: int, number: int) -> list[float]:
    rows = [entry for key, entry in entries.items() if key.startswith(f"{cell}/")]
    return [row["figures"][number] for row in rows if "error" not in row and row["figures"][number]]


def test_a_row_summarizes_the_runs_of_its_cell(plan: SweepPlan) -> None:
    entries = journal_entries(plan)
    table = table_of(plan, entries)
    rows = table.rows()
    assert [row["links.loss_ratio"] for row in rows] == ["0", "0", "0.8", "0.8"]
    assert [row["convoy.gap_m"] for row in rows] == ["3", "10"] * 2
    for cell in (0, 1, 3):
        row, known = rows[cell], values(entries, cell, 0)
        assert row["runs"] == SEEDS
        assert row["errors"] == (cell == 1)
        assert row["failed"] == sum(value > 0.9 for value in known)
        assert row["cross_track_error_m_max.count"] == len(known)
        assert row["cross_track_error_m_max.median"] == pytest.approx(np.median(known))
        assert row["cross_track_error_m_max.p95"] == pytest.approx(np.percentile(known, 95))
        assert row["cross_track_error_m_max.maximum"] == max(known)
        assert row["true_gap_m_min.count"] == len(values(entries, cell, 1)) == 3
        assert row["true_gap_m_min.minimum"] == min(values(entries, cell, 1))
        broken = sum(value > 0.5 for value in known)
        assert row["error_m=0.02.broken"] == broken
        low, high = agresti_coull(broken, len(known))
        assert row["error_m=0.02.broken_ratio_low"] == low
        assert row["error_m=0.02.broken_ratio_high"] == high
        worst = entries[f"{cell}/{row['worst_seed']}"]["figures"][0]
        assert worst == max(known)
        assert row["worst_command"].endswith(f"--seed {row['worst_seed']} --clock virtual")
    assert table.errors == SEEDS + 1


def test_all_files_agree(plan: SweepPlan, tmp_path: Path) -> None:
    table = table_of(plan, journal_entries(plan))
    write_files(tmp_path, tables_of(table))
    whole = json.loads((tmp_path / "sweep.json").read_text())
    assert whole["schema"] == "convoy.sweep/2"
    assert whole["configuration"]["--seeds"] == SEEDS
    for name, key in (("sweep.csv", "cells"), ("runs.csv", "runs")):
        with (tmp_path / name).open(newline="") as file:
            rows = list(csv.DictReader(file))
        for text, row in zip(rows, whole[key], strict=True):
            assert [*text] == [*row]
            assert float(text["convoy.gap_m"]) == row["convoy.gap_m"]
            for column in text.keys() - {"convoy.gap_m", "links.loss_ratio"}:
                assert text[column] == ("" if row[column] is None else str(row[column]))
    assert len(whole["runs"]) == plan.runs


def test_without_runs_the_interval_is_0_to_1() -> None:
    assert agresti_coull(0, 0) == (0.0, 1.0)


def test_the_order_of_the_journal_does_not_matter(plan: SweepPlan, tmp_path: Path) -> None:
    entries = journal_entries(plan)
    shuffled = list(entries.items())
    random.Random(7).shuffle(shuffled)
    for name, of in (("one", entries), ("other", dict(shuffled))):
        write_files(tmp_path / name, tables_of(table_of(plan, of)))
    for name in TABLES:
        one, other = ((tmp_path / folder / name).read_bytes() for folder in ("one", "other"))
        assert one == other
