"""Virtual runs write the same bytes, also on a processor with fewer instructions."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from click.testing import CliRunner

from scenarios.cli.main import cli

DURATION_S = 2.5
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


def drive_here(folder: Path) -> None:
    """Run the first seconds of all scenarios in virtual time."""
    for name in SHIPPED:
        arguments = ("--clock=virtual", f"--set=duration_s={DURATION_S}", "--quiet")
        done = CliRunner().invoke(cli, ["run", name, *arguments, f"--out={folder / name}"])
        assert done.exit_code == 0, done.output


def drive_elsewhere(folder: Path) -> None:
    """Run them in a process that takes this computer for another one."""
    code = (
        "from pathlib import Path; from tests.golden.test_same_bytes import drive_here; "
        f"drive_here(Path({str(folder)!r}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parents[2],
        env={**os.environ, **OTHER_COMPUTER},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_shipped_scenarios_give_the_same_bytes_elsewhere(tmp_path: Path) -> None:
    drive_here(tmp_path / "here")
    drive_elsewhere(tmp_path / "elsewhere")
    for name in SHIPPED:
        here, elsewhere = (
            (tmp_path / where / name / "run.mcap").read_bytes() for where in ("here", "elsewhere")
        )
        assert here == elsewhere, name
