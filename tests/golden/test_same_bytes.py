"""A virtual run is the same to the byte, also for a processor that knows fewer instructions."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

DURATION_S = 4.0
SHIPPED = ("lane_change", "lossy_lane_change", "church_lot", "highway")
OTHER_COMPUTER = {
    # NumPy picks its loops by what the processor can do; here it must do with the least.
    "NPY_DISABLE_CPU_FEATURES": " ".join(
        np.show_config(mode="dicts")["SIMD Extensions"].get("found", ())
    ),
    "OPENBLAS_CORETYPE": "Prescott",
    "OPENBLAS_NUM_THREADS": "2",
    "PYTHONHASHSEED": "7",
    "TZ": "Asia/Tokyo",
    "LC_ALL": "C",
}


def log_of(scenario: str, folder: Path, **environment: str) -> bytes:
    """Run the beginning of a scenario in virtual time in a process of its own."""
    folder.mkdir()
    done = subprocess.run(
        [
            *(sys.executable, "-m", "scenarios.cli", "run", scenario, "--clock=virtual"),
            *(f"--set=duration_s={DURATION_S}", "--quiet", "--out=run"),
        ],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return (folder / "run" / "run.mcap").read_bytes()


@pytest.mark.parametrize("scenario", SHIPPED)
def test_a_shipped_scenario_gives_the_same_bytes_elsewhere(scenario: str, tmp_path: Path) -> None:
    here = log_of(scenario, tmp_path / "here")
    elsewhere = log_of(scenario, tmp_path / "elsewhere", **OTHER_COMPUTER)
    assert here == elsewhere
