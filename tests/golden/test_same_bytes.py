"""Virtual runs write the same bytes, also on a processor with fewer instructions."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

DURATION_S = 4.0
SHIPPED = ("lane_change", "lossy_lane_change", "church_lot", "highway")
OTHER_COMPUTER = {
    # NumPy selects loops by features of the processor: disable all optional ones.
    "NPY_DISABLE_CPU_FEATURES": " ".join(
        np.show_config(mode="dicts")["SIMD Extensions"].get("found", ())
    ),
    "OPENBLAS_CORETYPE": "Prescott",
    "OPENBLAS_NUM_THREADS": "2",
    "PYTHONHASHSEED": "7",
    "TZ": "Asia/Tokyo",
    "LC_ALL": "C",
}


DRIVE = f"""
from click.testing import CliRunner
from scenarios.cli.main import cli
for name in {SHIPPED}:
    arguments = ["--clock=virtual", "--set=duration_s={DURATION_S}", "--quiet", f"--out={{name}}"]
    done = CliRunner().invoke(cli, ["run", name, *arguments])
    assert done.exit_code == 0, done.output
"""


def drive(folder: Path, **environment: str) -> None:
    """Run the first seconds of all scenarios in virtual time in a new process."""
    folder.mkdir()
    done = subprocess.run(
        [sys.executable, "-c", DRIVE],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_shipped_scenarios_give_the_same_bytes_elsewhere(tmp_path: Path) -> None:
    drive(tmp_path / "here")
    drive(tmp_path / "elsewhere", **OTHER_COMPUTER)
    for name in SHIPPED:
        here, elsewhere = (
            (tmp_path / where / name / "run.mcap").read_bytes() for where in ("here", "elsewhere")
        )
        assert here == elsewhere, name
