"""Longitudinal laws over loss and beacon rate: the amplification of spacing errors and speeds."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

from scenarios.definition.errors import ScenarioError
from scenarios.studies.figures.study import (
    COLLISIONS,
    LEAST_VEHICLES,
    FigureOptions,
    FigurePanel,
    FigurePoint,
    FigureStudy,
    point,
    value_of,
)
from scenarios.studies.many.sweeps.cell_table import SweepRun, SweepTable
from scenarios.studies.many.sweeps.plan import SweepPlan, planned

SCENARIO, VEHICLES, SEEDS = "plexe_sinusoidal", 5, 3
LOSS, RATE = "links.loss_ratio", "gnss.rate_hz"
LAWS: Mapping[str, tuple[str, float, float]] = {
    "ACC": ("acc", 2.0, 0.3),
    "CACC (PATH)": ("cacc", 5.0, 0.0),
    "Ploeg": ("ploeg", 2.0, 0.5),
    "flatbed": ("flatbed", 5.0, 0.0),
    "consensus": ("consensus", 15.0, 0.8),
}
"""Law, standstill gap (m) and headway (s) by name, as in Plexe's examples."""
LAW_KEY = "control.longitudinal"
LEAST_ERROR_M = 1e-3
"""Error of the vehicle ahead below which there is no gain."""
UNSTABLE = 1.05
"""Gain from head to tail from which a string is reported to amplify: sampling adds up to 2 %."""


def cacc_study(options: FigureOptions) -> FigureStudy:
    """Plan a sweep for each law. Each car is simulated in each run, so seeds are shared.

    The spacing error of the last vehicle is related to that of v3, the first vehicle behind one
    with the same law: v2 follows the lead, whose speed control announces its acceleration a control
    period earlier. On the straight road cars drive on when the path is lost, so that only the laws
    react to missing messages.
    """
    count = options.vehicles(VEHICLES)
    if count <= LEAST_VEHICLES:
        raise ScenarioError([f"figure cacc: given {count} vehicles, allowed 4 or more"])
    if any(text.strip().startswith(LAW_KEY) for text in options.sets):
        raise ScenarioError([f"--set: {LAW_KEY}: given, but the figure compares its own laws"])
    last = f"v{count}"
    axes = options.axes(f"{LOSS}=0,0.3,0.6", f"{RATE}=4,10")
    figures = (
        "v3.string.spacing_error_m_rms",
        f"{last}.string.spacing_error_m_rms",
        f"{last}.string.acceleration_gain_l2_from_lead",
        COLLISIONS,
    )
    plans = {
        name: planned(
            options.scenario or SCENARIO,
            vary=axes,
            seeds=options.seeds or SEEDS,
            sets=options.settings(
                f"convoy.vehicles={count}",
                "duration_s=16",
                "control.degradation.reaction=extrapolate",
                f"{LAW_KEY}={law}",
                f"speed.gap.standstill_m={standstill:g}",
                f"speed.gap.headway_s={headway:g}",
            ),
            figures=figures,
        )
        for name, (law, standstill, headway) in LAWS.items()
    }
    sweeps = {_label(name, plan): plan for name, plan in plans.items()}
    rates = _numbers(next(iter(sweeps.values())).axes[1].numbers)
    panels = [
        FigurePanel(
            title=f"{title}, beacons at {rate:g} Hz",
            x_label="lost messages, %",
            y_label=label,
            is_log=True,
            bound=1.0,
        )
        for title, label in (
            ("Spacing error", f"L2 norm, {last} over v3"),
            ("Acceleration", f"L2 norm, {last} over the lead"),
        )
        for rate in rates
    ]
    return FigureStudy(
        name="cacc",
        title=f"String stability of {count} vehicles behind a lead that varies its speed",
        sweeps=sweeps,
        panels=panels,
        points=partial(_points, last=last),
        outcome=partial(_outcome, panels=panels),
    )


def _label(name: str, plan: SweepPlan) -> str:
    """Name of a law with its headway, if it has one."""
    headway = plan.base.scenario.tables.speed.gap.headway_s
    return f"{name}, {headway:g} s" if headway else name


def _numbers(numbers: Sequence[float] | None) -> Sequence[float]:
    return numbers or ()


def _points(tables: Mapping[str, SweepTable], last: str) -> list[FigurePoint]:
    return [one for label, table in tables.items() for one in _points_of(label, table, last)]


def _points_of(label: str, table: SweepTable, last: str) -> Iterator[FigurePoint]:
    rates = _numbers(table.plan.axes[1].numbers)
    for cell in table.cells:
        loss, rate = (float(value) for value in cell.values)
        panel = list(rates).index(rate)
        spacing = [_spacing_gain(table, run, last) for run in cell.runs]
        name = f"{last}.string.acceleration_gain_l2_from_lead"
        speed = [value_of(table, run, name) for run in cell.runs]
        yield point(panel, label, 100.0 * loss, spacing, is_log=True)
        yield point(len(rates) + panel, label, 100.0 * loss, speed, is_log=True)


def _spacing_gain(table: SweepTable, run: SweepRun, last: str) -> float | None:
    first = value_of(table, run, "v3.string.spacing_error_m_rms")
    tail = value_of(table, run, f"{last}.string.spacing_error_m_rms")
    return None if first is None or tail is None or first < LEAST_ERROR_M else tail / first


def _outcome(points: Sequence[FigurePoint], panels: Sequence[FigurePanel]) -> str:
    """Name the laws that amplify without loss at the highest rate, by either norm."""
    half = len(panels) // 2
    least = min((one.x for one in points), default=0.0)
    shown = [one for one in points if one.x == least and one.panel in {half - 1, 2 * half - 1}]
    gains: dict[str, float] = {}
    for one in shown:
        if one.mean is not None:
            gains[one.series] = max(one.mean, gains.get(one.series, 0.0))
    amplify = [f"{name} ({gain:.2f})" for name, gain in gains.items() if gain > UNSTABLE]
    others = [f"{name} ({gain:.2f})" for name, gain in gains.items() if gain <= UNSTABLE]
    unknown = [name for name in dict.fromkeys(one.series for one in shown) if name not in gains]
    rate = panels[-1].title.rpartition(", ")[2] if panels else ""
    parts = [
        f"{words} {', '.join(laws)}"
        for words, laws in (
            ("grows with", amplify),
            ("does not grow with", others),
            ("has no gain above noise with", unknown),
        )
        if laws
    ]
    return f"with {least:g} % loss and {rate} the disturbance {'; '.join(parts)}"
