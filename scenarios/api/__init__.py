"""Run, open and study convoys from Python: the package `convoy`.

    import convoy

    run = convoy.run("lane_change", set={"links.loss_ratio": 0.4}, seed=3)
    run.summary.outcome
    run.vehicles["v4"].true.error_m          # a NumPy array; with times in true.t_s
    run.links["v1", "v3"].outcomes.to_pandas()
    run.string_errors                        # errors and gains along the string
    run.frequency_gains()                    # speed gains by frequency
    run.plot()
    run.report("run.html")

    old = convoy.open("runs/first")          # a folder, or a log
    convoy.runs().to_pandas()                 # a row for each run in a folder
    compared = convoy.compare("runs/first", run)
    compared.metrics, compared.plot()         # what differs, and errors along the path
    convoy.replay("runs/first", ["v1"], set={"control.controller": "stanley"})
    convoy.check("lane_change").warnings
    convoy.sweep("lane_change", {"links.loss_ratio": [0.0, 0.4]}, seeds=5).cells
    convoy.bisect("lossy_lane_change", "links.loss_ratio", "v4.error_m=0.5", share=0.05).boundary

Invalid input raises `convoy.Error`, with the sentences of the command line. Errors of the
operating system, such as a full disk, are OSError as usual. Names and columns end in their units.

home       the packages of this installation, which are imported first
running    run, check and replay
recorded   open and runs, and the class of recorded runs
comparing  compare
sweeping   sweep and bisect
"""

from .home import import_own_packages

import_own_packages()

from scenarios.api.comparing import ComparedRuns, compare  # noqa: E402
from scenarios.api.recorded import Run, open, runs  # noqa: A004, E402
from scenarios.api.running import check, replay, run  # noqa: E402
from scenarios.api.sweeping import Sweep, bisect, sweep  # noqa: E402
from scenarios.results.data_table import DataTable  # noqa: E402
from scenarios.studies.many.boundary import BoundaryResult  # noqa: E402
from transport.texts import ConvoyError as Error  # noqa: E402

__all__ = [
    "BoundaryResult",
    "ComparedRuns",
    "DataTable",
    "Error",
    "Run",
    "Sweep",
    "bisect",
    "check",
    "compare",
    "open",
    "replay",
    "run",
    "runs",
    "sweep",
]
