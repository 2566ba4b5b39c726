"""The figures by name."""

from collections.abc import Callable, Mapping

from scenarios.studies.figures.cacc import cacc_study
from scenarios.studies.figures.error_along_string import error_along_string_study
from scenarios.studies.figures.loss_over_gap import loss_over_gap_study
from scenarios.studies.figures.study import FigureOptions, FigureStudy

FIGURE_STUDIES: Mapping[str, Callable[[FigureOptions], FigureStudy]] = {
    "cacc": cacc_study,
    "error-along-string": error_along_string_study,
    "loss-over-gap": loss_over_gap_study,
}
