"""Run again from a log."""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from scenarios.api.comparing import AnyRun, path_of
from scenarios.api.recorded import Run
from scenarios.api.running import Settings, overrides_of, run_loaded
from scenarios.results.log_queries.session import replayed_session
from scenarios.results.log_summary import log_in
from scenarios.results.summary import ClockName


def replay(
    log: AnyRun,
    vehicles: Sequence[str],
    *,
    set: Settings | None = None,  # noqa: A002 - as on the command line
    seed: int | None = None,
    clock: ClockName = "virtual",
    out: str | Path | None = None,
    partial: bool = False,
    confirmed: bool = False,
    report: Callable[[str], None] | None = None,
) -> Run:
    """Let recorded `vehicles` send their messages again, and simulate the others behind them.

    Like `convoy replay`; `partial` allows a damaged or incomplete log. The other arguments are
    those of `run`. Raises Error for an invalid log, vehicle or setting.
    """
    scenario = replayed_session(
        log_in(path_of(log)), vehicles, overrides_of(set), seed, warn=warnings.warn, partial=partial
    )
    with TemporaryDirectory(prefix="convoy-") as folder:
        file = Path(folder, f"{scenario.name}.toml")
        file.write_text(scenario.text, encoding="utf-8")
        return run_loaded(
            scenario, [str(file)], clock=clock, out=out, confirmed=confirmed, report=report
        )
