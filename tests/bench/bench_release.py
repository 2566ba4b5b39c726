"""Processor time of a virtual run now and in an earlier state: `-m tests.bench.bench_release REV`.

REV is a commit or tag, such as that of the last release. Its sources are unpacked into a temporary
folder, and both states run `convoy run lane_change --clock virtual` in turn with this interpreter.
The ratio of each pair of runs holds on a busy machine, where single times do not.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
START = "import sys; from scenarios.cli.__main__ import main; sys.exit(main())"


def unpack(revision: str, folder: Path) -> Path:
    """Write the sources of a revision into `folder`, and return it."""
    archive = folder / "sources.tar"
    command = ["git", "archive", "--format=tar", f"--output={archive}", revision]
    subprocess.run(command, check=True, cwd=ROOT)
    with tarfile.open(archive) as file:
        file.extractall(folder / "sources", filter="data")
    return folder / "sources"


def processor_s(sources: Path, out: Path, scenario: str) -> float:
    """User and system time (s) of one run, children included."""
    options = ["run", scenario, "--clock", "virtual", "--quiet", "--out", str(out)]
    child = subprocess.Popen(
        [sys.executable, "-c", START, *options],
        cwd=sources,
        env=os.environ | {"PYTHONPATH": str(sources)},
        stdout=subprocess.DEVNULL,
    )
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        sys.exit(f"error: the run in {sources} ended with {child.returncode}")
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("revision")
    parser.add_argument("--scenario", default="lane_change")
    parser.add_argument("--pairs", type=int, default=7)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        earlier = unpack(given.revision, folder)
        now, before = [], []
        for k in range(given.pairs + 1):  # the first pair fills the caches
            now.append(processor_s(ROOT, folder / f"now-{k}", given.scenario))
            before.append(processor_s(earlier, folder / f"before-{k}", given.scenario))
    ratios = [ours / theirs for ours, theirs in zip(now[1:], before[1:], strict=True)]
    print(
        f"{given.scenario}: {statistics.median(now[1:]):.2f} s now, "
        f"{statistics.median(before[1:]):.2f} s at {given.revision}, ratio "
        f"{statistics.median(ratios):.3f} ({min(ratios):.3f} to {max(ratios):.3f})"
    )


if __name__ == "__main__":
    main()
