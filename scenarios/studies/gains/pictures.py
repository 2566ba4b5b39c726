"""Pictures of the gains report. Needs matplotlib, so import it only when drawing."""

from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from scenarios.studies.gains.curves import (
    abscissa_over_speed,
    certified_acceleration,
    error_propagation,
    roots_over_loadings,
)
from scenarios.studies.gains.numbers import Report, Subject
from scenarios.studies.gains.sets import intersection, stabilising_set, stabilising_slices
from scenarios.studies.picture_style import STYLE

OF_SETS: dict[str, Callable[[Subject], Figure]] = {
    "stabilising_slices.png": stabilising_slices,
    "stabilising_set.png": stabilising_set,
    "intersection.png": intersection,
}
OF_NUMBERS: dict[str, Callable[[Subject, Report], Figure]] = {
    "abscissa.png": abscissa_over_speed,
    "certified_acceleration.png": certified_acceleration,
    "propagation.png": error_propagation,
    "roots_over_loadings.png": roots_over_loadings,
}


def draw_all(subject: Subject, report: Report, out_dir: Path) -> list[str]:
    """Write all pictures as PNG into `out_dir` and give their file names."""
    with mpl.rc_context(STYLE):
        figures = {name: draw(subject) for name, draw in OF_SETS.items()}
        figures |= {name: draw(subject, report) for name, draw in OF_NUMBERS.items()}
        for name, figure in figures.items():
            figure.savefig(out_dir / name, metadata={"Software": ""})
    return list(figures)
