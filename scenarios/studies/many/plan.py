"""The runs of a sweep, with the figures and limits to evaluate."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from decimal import Decimal
from difflib import get_close_matches
from functools import partial
from hashlib import sha256
from itertools import product
from math import isfinite
from pathlib import Path
from types import NoneType
from typing import Any, get_args

from scenarios.definition.errors import ScenarioError
from scenarios.definition.library import ScenarioFile
from scenarios.definition.overrides import (
    OverrideError,
    key_parts,
    merged,
    override,
    parse_override,
    value_at,
)
from scenarios.definition.run_limits import Limit, parsed_limit
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.limit_rows import OWN_FIGURES
from scenarios.definition.topology import usual_links
from scenarios.definition.versions import current_stamp, plug_in_digests
from scenarios.results.events import EventKind
from scenarios.results.limits import broken_by
from scenarios.results.links import SAFE_AGES_MS, LinkSummary
from scenarios.results.summary import RunSummary
from scenarios.results.vehicle_figures import VehicleSummary
from scenarios.studies.job import Job
from scenarios.studies.many.variant import Variant, variant_of
from transport.topics import DropReason
from vehicles.messages import Mode

# ---- A key that varies and its values, parsed from the command line


MAX_VALUES = 1000
ALLOWED_FORMS = "KEY=START:STOP:STEP or KEY=a,b,c, such as links.loss_ratio=0:0.9:0.1"
NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,3})?"
RANGE = re.compile(rf"\s*({NUMBER})\s*:\s*({NUMBER})\s*:\s*({NUMBER})\s*")
WITHOUT_STEP = re.compile(rf"\s*({NUMBER})\s*:\s*({NUMBER})\s*")
_DOTS = re.compile(r"(?<=\d)\.\.(?=[\d+-])")
BRACKETS = {"[": 1, "{": 1, "]": -1, "}": -1}


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepAxis:
    key: str
    texts: tuple[str, ...]

    @property
    def overrides(self) -> tuple[str, ...]:
        return tuple(f"{self.key}={text}" for text in self.texts)

    @property
    def values(self) -> tuple[Any, ...]:
        return tuple(parse_override(override)[1] for override in self.overrides)

    @property
    def numbers(self) -> tuple[float, ...] | None:
        """The values if all are numbers, else None."""
        values = self.values
        if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
            return tuple(map(float, values))
        return None


def parsed_axis(text: str) -> SweepAxis:
    """Parse `KEY=START:STOP:STEP`, both ends included, or `KEY=a,b,c`; raises ScenarioError."""
    key, _, given = text.partition("=")
    key = ".".join(key_parts(key))
    try:
        parse_override(f"{key}=0")
        texts = _texts(given)
        axis = SweepAxis(key=key, texts=texts)
        shown = [repr(value) if isinstance(value, str) else str(value) for value in axis.values]
    except ValueError as error:  # includes OverrideError
        why = ALLOWED_FORMS if isinstance(error, OverrideError) else error
        raise ScenarioError([f"--vary: given {text!r}, allowed {why}"]) from error
    if key == "seed":
        raise ScenarioError(["--vary: seed: use --seeds N for the seeds 1 to N"])
    if twice := [value for k, value in enumerate(shown) if value in shown[:k]]:
        raise ScenarioError([f"--vary: {key}: given {twice[0]} twice"])
    return axis


def _texts(given: str) -> tuple[str, ...]:
    """Split into values; raises ValueError with the allowed form."""
    ends = RANGE.fullmatch(given)
    if span := WITHOUT_STEP.fullmatch(_DOTS.sub(":", given)):
        raise ValueError(f"a range START:STOP:STEP, such as {span[1]}:{span[2]}:0.1")
    texts = tuple(_range(*map(Decimal, ends.groups()))) if ends else tuple(_split(given))
    if not all(texts):
        raise ValueError(ALLOWED_FORMS)
    if len(texts) > MAX_VALUES:
        raise ValueError(f"at most {MAX_VALUES} values of a key")
    return texts


def _range(start: Decimal, stop: Decimal, step: Decimal) -> list[str]:
    """Exact decimal numbers from start to stop, both included."""
    if not step or (stop - start) * step < 0:
        raise ValueError("a STEP that leads from START to STOP")
    count, rest = divmod(stop - start, step)
    if rest:
        last = start + count * step
        raise ValueError(f"a STEP that reaches STOP, as in {start}:{last}:{step}")
    if count >= MAX_VALUES:
        raise ValueError(f"at most {MAX_VALUES} values of a key")
    return [f"{(start + number * step).normalize() + 0:f}" for number in range(int(count) + 1)]


def _split(given: str) -> Iterator[str]:
    """Split at commas, but not within brackets or quotes."""
    depth, quote, word = 0, "", ""
    for letter in given:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        depth += 0 if quote else BRACKETS.get(letter, 0)
        if letter == "," and not depth and not quote:
            yield word.strip()
            word = ""
        else:
            word += letter
    yield word.strip()


def parsed_axes(texts: Sequence[str]) -> tuple[SweepAxis, ...]:
    """Parse all `--vary`; raises ScenarioError, also for a key given twice."""
    axes = tuple(map(parsed_axis, texts))
    keys = [axis.key for axis in axes]
    if twice := [key for k, key in enumerate(keys) if key in keys[:k]]:
        raise ScenarioError(
            [f"--vary: given {twice[0]} twice; give all values of a key in one --vary"]
        )
    return axes


def cells(axes: Sequence[SweepAxis]) -> list[tuple[str, ...]]:
    """Return all combinations of values as overrides; the last key varies fastest."""
    return list(product(*(axis.overrides for axis in axes)))


# ---- Figures of a summary by name: of the worst follower, a vehicle, or a link


SUBFIELDS: Mapping[str, Sequence[str]] = {
    "ticks_by_mode": get_args(Mode),
    "dropped": get_args(DropReason),
    "safe_time_ratio": tuple(map(str, SAFE_AGES_MS)),
}
"""Fields that are tables, with their possible keys."""
RUN_FIELDS = ("ran_s",)
MAX_SUGGESTIONS = 4


@dataclass(frozen=True, slots=True)
class SweepFigure:
    """A figure of a summary by its name.

    `FIELD` is the value of the worst follower: the largest, or for `*_min` and `safe_time_ratio`
    the smallest. `v3.FIELD` is the value of one vehicle, `links.FIELD` of the worst link,
    `v1:v2.FIELD` of one link. `events.KIND` is a count. Dots separate nested fields.
    `own_figures.NAME`, a figure of the user's class, is the largest of all vehicles.
    """

    name: str

    @property
    def is_worst_when_least(self) -> bool:
        return self.name.endswith("_min") or "safe_time_ratio" in self.name.split(".")

    @property
    def is_gain(self) -> bool:
        return "_gain_" in self.name or "_growth_" in self.name

    def of(self, summary: RunSummary) -> float | None:
        """The value in a run, or None if nothing was measured."""
        scope, _, rest = self.name.partition(".")
        if scope == "events":
            return float(sum(event.kind == rest for event in summary.events))
        if self.name in RUN_FIELDS:
            return float(getattr(summary, self.name))
        rows, path = self._rows(summary, scope, rest)
        values = [_value(row, path.split(".")) for row in rows]
        known = [float(value) for value in values if value is not None and isfinite(value)]
        if not known:
            return None
        return min(known) if self.is_worst_when_least else max(known)

    def _rows(self, summary: RunSummary, scope: str, rest: str) -> tuple[Iterable[Any], str]:
        if scope == "links":
            return summary.links, rest
        if ":" in scope:
            ends = tuple(scope.split(":"))
            return [row for row in summary.links if (row.sender, row.receiver) == ends], rest
        if scope == OWN_FIGURES:
            return summary.vehicles, self.name
        if scope in VEHICLE_FIELD_HEADS:
            return [row for row in summary.vehicles if row.role == "follower"], self.name
        return [row for row in summary.vehicles if row.name == scope], rest


def _value(row: Any, path: Sequence[str]) -> float | None:
    for part in path:
        if isinstance(row, Mapping):
            # A missing count is 0; a share without commands and a figure that failed are unknown.
            row = row.get(part, None if path[0] in {"safe_time_ratio", OWN_FIGURES} else 0)
        else:
            row = getattr(row, part)
    return None if row is None else float(row)


def _paths(kind: type) -> Iterator[str]:
    """Yield the dotted names of all numbers of a summary class."""
    for one in fields(kind):
        types = set(get_args(one.type) or (one.type,)) - {NoneType}
        if types <= {int, float}:
            yield one.name
        elif one.name in SUBFIELDS:
            yield from (f"{one.name}.{word}" for word in SUBFIELDS[one.name])
        elif isinstance(one.type, type) and is_dataclass(one.type):
            yield from (f"{one.name}.{path}" for path in _paths(one.type))


VEHICLE_FIELDS = tuple(_paths(VehicleSummary))
LINK_FIELDS = tuple(_paths(LinkSummary))
VEHICLE_FIELD_HEADS = frozenset(path.split(".")[0] for path in VEHICLE_FIELDS)


def parsed_figure(
    text: str,
    vehicles: Sequence[str],
    own_figures: Sequence[str] = (),
    pairs: Iterable[tuple[str, str]] = (),
) -> SweepFigure:
    """Parse the name of a figure; raises ScenarioError with similar names.

    `own_figures` are the names of those of the user's classes, `pairs` the links, by default those
    of the usual information flow.
    """
    own = [f"{OWN_FIGURES}.{name}" for name in own_figures]
    ends = pairs or usual_links(vehicles)
    links = ("links", *(f"{sender}:{receiver}" for sender, receiver in ends))
    scope, dot, _ = text.partition(".")
    if scope in vehicles and dot:
        known = [f"{scope}.{path}" for path in (*VEHICLE_FIELDS, *own)]
    elif scope in links and dot:
        known = [f"{scope}.{path}" for path in LINK_FIELDS]
    else:
        known = [
            *VEHICLE_FIELDS,
            *own,
            *RUN_FIELDS,
            *(f"events.{kind}" for kind in get_args(EventKind)),
        ]
        known += [f"links.{path}" for path in LINK_FIELDS]
    if text in known:
        return SweepFigure(text)
    near = _near(text, known)
    hint = f"similar: {', '.join(near)}" if near else "see `convoy reference fields`"
    raise ScenarioError([f"--metric: unknown metric {text!r}, {hint}"])


def _near(text: str, known: Sequence[str]) -> list[str]:
    inside = [name for name in known if len(text) > 2 and text in name]
    return list(dict.fromkeys([*get_close_matches(text, known, n=MAX_SUGGESTIONS), *inside]))[
        :MAX_SUGGESTIONS
    ]


# ---- Plan


DEFAULT_FIGURE = "cross_track_error_m_max"
MAX_RUNS = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPlan:
    """A scenario, the keys that vary, the seeds 1 to `seeds`, the figures and limits.

    A seed gives the same random numbers in every cell. `base` is the scenario with the overrides of
    all runs.
    """

    base: Variant
    axes: tuple[SweepAxis, ...]
    seeds: int
    figures: tuple[SweepFigure, ...]
    limits: tuple[Limit, ...]
    plug_ins: tuple[str, ...] = ()
    """Controllers of all runs."""
    contents: str = ""
    """Digest of the scenarios of all values, with the files that they name."""

    @property
    def cells(self) -> list[tuple[str, ...]]:
        """The overrides of each cell, one per axis."""
        return cells(self.axes)

    @property
    def runs(self) -> int:
        return len(self.cells) * self.seeds

    def variants(self, cell: Sequence[str]) -> list[Variant]:
        overrides = (*self.base.overrides, *cell)
        return [
            replace(self.base, overrides=overrides, seed=seed) for seed in range(1, self.seeds + 1)
        ]

    def jobs(self) -> list[Job]:
        return [
            Job(
                key=run_key(place, variant.seed),
                work=partial(figures_of, variant, self.figures, self.limits),
                command=variant.command,
            )
            for place, cell in enumerate(self.cells)
            for variant in self.variants(cell)
        ]

    def identity(self) -> dict[str, Any]:
        """Everything that the results depend on, named as on the command line."""
        return {
            "SCENARIO": self.base.name,
            "scenario digest": sha256(self.base.text.encode()).hexdigest()[:12],
            "--set": list(self.base.overrides),
            "--vary": [f"{axis.key}={','.join(axis.texts)}" for axis in self.axes],
            "--seeds": self.seeds,
            "--metric": [figure.name for figure in self.figures],
            "--limit": [str(limit) for limit in self.limits],
            **asdict(current_stamp()),
            "plug_ins": dict(plug_in_digests(self.plug_ins)),
            "contents digest": self.contents,
        }


def run_key(cell: int, seed: int) -> str:
    return f"{cell}/{seed}"


def figures_of(
    variant: Variant, figures: Sequence[SweepFigure], limits: Sequence[Limit]
) -> dict[str, Any]:
    """Simulate a run; return its journal entry, in the order of figures and limits."""
    summary = variant.run()
    return {
        "outcome": summary.outcome,
        "reason": summary.reason,
        "figures": [figure.of(summary) for figure in figures],
        "broken": [broken_by(limit, summary) for limit in limits],
    }


def planned(
    name: str,
    *,
    vary: Sequence[str],
    seeds: int,
    sets: Sequence[str] = (),
    metrics: Sequence[str] = (),
    limits: Sequence[str] = (),
) -> SweepPlan:
    """Build a sweep from the texts of the command line.

    Each value of each key is validated with the first values of the other keys. Raises
    ScenarioError with a line for each problem.
    """
    axes = parsed_axes(vary)
    fixed = {text.partition("=")[0].strip() for text in sets}
    if both := [axis.key for axis in axes if axis.key in fixed]:
        raise ScenarioError([f"--vary: {both[0]}: given by --set as well; use one of them"])
    plan = SweepPlan(
        base=variant_of(name, sets),
        axes=axes,
        seeds=seeds,
        figures=(),
        limits=(),
    )
    if plan.runs > MAX_RUNS:
        raise ScenarioError([f"{name}: given {plan.runs} runs, allowed {MAX_RUNS}"])
    _refuse_missing_entries(plan)
    scenarios = list(_scenarios(plan))
    vehicles = max((scenario.vehicle_names for scenario in scenarios), key=len)
    own = tuple(dict.fromkeys(name for scenario in scenarios for name in scenario.own_figures))
    pairs = dict.fromkeys(pair for scenario in scenarios for pair in scenario.links)
    digests = " ".join(scenario.digest for scenario in scenarios)
    names = dict.fromkeys(metrics or [DEFAULT_FIGURE])
    return replace(
        plan,
        plug_ins=tuple(sorted({name for one in scenarios for name in one.plug_ins})),
        contents=sha256(digests.encode()).hexdigest()[:12],
        figures=tuple(parsed_figure(text, vehicles, own, pairs) for text in names),
        limits=tuple(dict.fromkeys(parsed_limit(text, vehicles, own) for text in limits)),
    )


def refuse_picture(plan: SweepPlan) -> None:
    """Raise ScenarioError if the keys of a sweep cannot be drawn."""
    axes = plan.axes
    if len(axes) not in {1, 2}:
        wrong = f"{len(axes) or 'no'} keys vary, a picture needs one or two; fix others by --set"
    elif len(axes) == 2 and not any(axis.numbers for axis in axes):
        wrong = f"neither {axes[0].key} nor {axes[1].key} has only numbers, a picture needs one"
    else:
        return
    raise ScenarioError([f"--output: {wrong}"])


def _refuse_missing_entries(plan: SweepPlan) -> None:
    """Raise ScenarioError for a key inside a list entry that neither scenario nor axes have."""
    base = plan.base
    tables = merged(ScenarioFile(base.name, Path(), base.text), base.overrides).raw
    for axis in plan.axes:
        try:
            value_at(tables, axis.key)
            override(tables, *parse_override(axis.overrides[0]))
        except OverrideError as error:
            raise ScenarioError([f"--vary: {axis.key}: {error}"]) from error


def _scenarios(plan: SweepPlan) -> Iterator[Scenario]:
    """Load the first run of each value."""
    first = [axis.overrides[0] for axis in plan.axes]
    combinations = [first] + [
        [*first[:index], override, *first[index + 1 :]]
        for index, axis in enumerate(plan.axes)
        for override in axis.overrides[1:]
    ]
    for cell in combinations:
        try:
            yield plan.variants(cell)[0].scenario
        except ScenarioError as error:
            raise ScenarioError(_as_varied(line, plan.axes) for line in error.lines) from error


def _as_varied(line: str, axes: Sequence[SweepAxis]) -> str:
    """Name the option that holds the refused value."""
    by_set = "--set: "
    if any(line.startswith(f"{by_set}{axis.key}") for axis in axes):
        return line.replace(by_set, "--vary: ", 1)
    return line
