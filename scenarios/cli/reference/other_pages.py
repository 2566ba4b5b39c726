"""Reference pages about summaries, intervals and exit codes."""

from collections.abc import Mapping

from scenarios.cli.reference.printing import print_section, print_text
from scenarios.results.summary import documented_fields
from scenarios.runs.stop import EXIT_CODES


def fields_page() -> None:
    print_text(
        "Fields of summary.json and of `convoy report --json`. A field is null where nothing was "
        "measured."
    )
    for group, docs in documented_fields().items():
        print_section(group, docs.items())


def intervals_page() -> None:
    print_text(
        "Intervals of studies, and the share of repetitions in which they contained a known truth."
    )
    for heading, (text, rows) in INTERVALS.items():
        print_section(heading, rows.items(), text)


INTERVALS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "bisect, 95 %": (
        "The share of broken runs is fitted by an S-shaped curve, averaged over the logistic, "
        "complementary log-log and log-log functions: the posterior of the boundary on a grid, "
        "with a uniform prior in the boundary and in the logarithm of the width. Each run has its "
        "own seed. A quarter of the runs so far is added at five quantiles of the boundary, until "
        "the interval is narrow enough and 20 broken and 20 kept runs are expected at the share: "
        "400 runs for 5 %. Rows: share, and width of a logistic curve as a part of the range; "
        "400 repetitions with boundaries from 0.2 to 0.8 of the range and default options.",
        {
            "50 %, width 0.005": "96.8 %, half-width 0.008, 50 runs on average",
            "50 %, width 0.05": "93.8 %, half-width 0.018, 201 runs",
            "50 %, width 0.15": "95.5 %, half-width 0.023, 929 runs",
            "5 %, width 0.005": "93.0 %, half-width 0.003, 478 runs",
            "5 %, width 0.05": "96.2 %, half-width 0.019, 751 runs",
            "5 %, width 0.15": "94.2 %, half-width 0.051, 1000 runs",
            "95 %, width 0.05": "93.5 %, half-width 0.019, 746 runs",
            "step, 50 %": "97.2 %, half-width 0.005, 50 runs",
            "other curves": "89 to 99 %: probit, complementary log-log, log-log and Weibull",
        },
    ),
    "sweep, 95 %": (
        "Shares of broken limits: Agresti-Coull. Means: Student's t; those of gains are geometric, "
        "by their logarithms. Medians and quantiles have no interval.",
        {"shares, any": "at least 92 % from 10 runs on; 89 % with 5"},
    ),
    "diff, 99 %": (
        "Means over seeds: Student's t of pairs with equal seeds, else Welch's. Counts that are "
        "equal in all runs of a side get the spread of one more run that differs by one.",
        {
            "normal, Gumbel": "98.7 to 99.7 % with 2 to 20 runs a side",
            "log-normal, equal": "99.2 to 99.8 %",
            "log-normal, different": "91 to 98 %",
            "events of equal rates": "99 to 100 %",
        },
    ),
}
"""Text and rows by heading; tests/scenarios/studies/many/boundary/test_curve.py has the first."""


def exit_codes_page() -> None:
    print_text("Exit codes of all commands.")
    print_section("exit codes", [(str(code), meaning) for code, meaning in EXIT_CODES.items()])
