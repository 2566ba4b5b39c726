"""Limits that are not judged, because messages that they judge are missing in the log."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from scenarios.definition.schema.limit_rows import LIMITS, LimitRow, row_of
from scenarios.results.holes import RecordKind, UnseenSpan
from scenarios.results.summary import LimitFigure

ROUNDING_S = 1e-9
Needed = tuple[str, RecordKind]
"""Vehicle and kind of its messages."""


def judged_by_record(
    figures: Sequence[LimitFigure],
    names: Sequence[str],
    unseen: Sequence[UnseenSpan],
    allowed_s: float | None,
) -> tuple[LimitFigure, ...]:
    """Mark kept limits whose vehicles lack messages for more than `allowed_s` (s, None: 0).

    `names` are the vehicles, lead first. An explicit `allowed_s` is a limit of its own.
    """
    spans: defaultdict[Needed, list[UnseenSpan]] = defaultdict(list)
    for span in unseen:
        spans[span.vehicle, span.kind].append(span)
    allowed = allowed_s or 0.0
    too_many = {
        needed: missed
        for needed, missed in spans.items()
        if sum([span.missing_s for span in missed]) > allowed + ROUNDING_S
    }
    result = [_judged(figure, names, too_many) for figure in figures] if too_many else [*figures]
    if allowed_s is not None:
        result.append(_holes(spans, allowed))
    return tuple(result)


def _judged(
    figure: LimitFigure, names: Sequence[str], spans: Mapping[Needed, Sequence[UnseenSpan]]
) -> LimitFigure:
    """Return a figure, marked as not judged if it is kept but messages are missing."""
    if figure.broken:
        return figure
    for needed in _needed(figure, names):
        if needed in spans:
            line = f"limits.{figure.limit} = {figure.bound:g}: not judged: {_words(spans[needed])}"
            return replace(figure, judged=False, message=line)
    return figure


def _words(spans: Sequence[UnseenSpan]) -> str:
    first, more = spans[0], len(spans) - 1
    others = f" and {more} more {'time' if more == 1 else 'times'}" if more else ""
    return (
        f"the log lacks {first.kind}s of {first.vehicle} from {first.from_s:.2f} to "
        f"{first.to_s:.2f} s{others}"
    )


def _holes(spans: Mapping[Needed, Sequence[UnseenSpan]], allowed: float) -> LimitFigure:
    """Return the figure of the limit on holes: the largest missing time of one vehicle."""
    missing = {needed: sum([span.missing_s for span in missed]) for needed, missed in spans.items()}
    worst = max(missing, key=missing.__getitem__, default=None)
    value, line = (0.0, "") if worst is None else (missing[worst], "")
    if worst is not None and value > allowed + ROUNDING_S:
        line = f"limits.holes_s_max = {allowed:g}: {value:.2f} s: {_words(spans[worst])}"
    return LimitFigure(limit="holes_s_max", bound=allowed, value=value, message=line)


def _needed(figure: LimitFigure, names: Sequence[str]) -> Iterator[Needed]:
    """Yield the messages that a limit judges."""
    key = figure.limit.removeprefix(f"{figure.vehicle}.")
    row = LIMITS["collisions_max"] if key == "after_collision" else row_of(key)
    if row is not None:
        for name in _own(figure, row, names):
            if row.by_decisions:
                yield name, "decision"
            if row.by_truth:
                for witness in _witnesses(row, name, names):
                    yield witness, "true pose"
        return
    yield figure.vehicle, "decision"  # a deadline
    if key.startswith("recovery"):
        yield figure.vehicle, "true pose"
        yield names[0], "true pose"


def _own(figure: LimitFigure, row: LimitRow, names: Sequence[str]) -> Sequence[str]:
    if figure.vehicle:
        return [figure.vehicle]
    return names if row.of_lead else names[1:]


def _witnesses(row: LimitRow, name: str, names: Sequence[str]) -> Sequence[str]:
    match row.witness:
        case "all":
            return names
        case "lead":
            return [name, names[0]]
        case "predecessor" if name != names[0]:
            return [name, names[names.index(name) - 1]]
    return [name]
