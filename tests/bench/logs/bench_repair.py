"""Time to repair the log of a killed recorder: `python -m tests.bench.logs.bench_repair`.

Simulates four vehicles until the log has 30 MB, rewrites it in the small chunks of a run on the
wall clock, and truncates it. Then times the repair, opening the log, and computing its figures,
compared to a plain Python loop. Creating the log takes most of a minute.
"""

import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import scenario_from_text
from scenarios.results.files import LOG_NAME
from scenarios.results.log_summary import summary_of
from scenarios.results.summarise import METADATA_NAME
from scenarios.runs.stop import Stop
from scenarios.runs.virtual.logged_run import run_virtual
from tests.bench.bench_run import LOOP, Row, plain_loop, print_rows, timed
from transport.log.reader import LogReader
from transport.log.repair import repair
from transport.log.writer import LogWriter
from vehicles.schedule import MILLISECOND, Timer

READY_S = 2.0
KEPT_RATIO = 0.99
"""Where the log is cut; this is in the middle of a record."""
LAP = '{ length_m = 400.0 }, { length_m = 600.0, radius_m = 200.0, turn = "left" },'
SCENARIO = f"""
name = "long"
duration_s = 440.0
[convoy]
vehicles = 4
[path]
kind = "segments"
segments = [{LAP * 15}]
"""


def broken_log(folder: Path) -> Path:
    """Write the log of a long drive as a recorder that is killed."""
    run_virtual(scenario_from_text(SCENARIO, label="bench"), folder, Stop())
    whole, broken = LogReader(folder / LOG_NAME), folder / "broken.mcap"
    flushing = Timer(400 * MILLISECOND)
    with LogWriter(broken) as log:
        log.metadata(METADATA_NAME, whole.metadata()[METADATA_NAME])
        log.attach(ATTACHED_AS, "application/toml", whole.attachments()[ATTACHED_AS])
        for at, _, message in whole.messages():
            log.write(at, message)
            if flushing.is_due(at):
                log.flush()
    with broken.open("r+b") as file:
        file.truncate(round(KEPT_RATIO * broken.stat().st_size))
    return broken


def ready(log: Path) -> Iterator[Row]:
    """Rows of the steps after a kill."""
    loop = timed(plain_loop)
    yield Row("log, MB", f"{log.stat().st_size * 1e-6:.0f}")
    repaired = timed(partial(repair, log))
    opened = timed(partial(LogReader, log))
    seconds = repaired.wall_s + opened.wall_s
    yield Row("repaired, s", f"{repaired.wall_s:.2f}")
    yield Row("repaired and opened, s", f"{seconds:.2f}", f"{READY_S}", seconds < READY_S)
    yield Row(
        f"  in loops of {LOOP // 1_000_000} million additions",
        f"{seconds / loop.wall_s:.1f} (a loop takes {loop.wall_s:.2f} s)",
    )
    summed = timed(partial(summary_of, log))
    yield Row("figures from its messages, s", f"{summed.wall_s:.2f}")


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        print_rows("the log of a killed recorder", list(ready(broken_log(Path(name)))))


if __name__ == "__main__":
    main()
