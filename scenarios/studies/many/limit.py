"""What a run must hold, in a word of the command line, and by how much it does."""

from dataclasses import dataclass
from math import inf, isfinite, nan

from scenarios.definition.errors import ScenarioError
from scenarios.results.events.encounters import EventKind
from scenarios.results.summary import RunSummary

EVENTS: dict[str, EventKind] = {
    "lane": "lane_departure",
    "collision": "collision",
    "near_miss": "near_miss",
    "path_lost": "path_lost",
}
FIGURES = {"error_m": "cross_track_error_m_max", "gap_m": "true_gap_m_min"}
ALLOWED = (
    f"{', '.join(EVENTS)}, or {' and '.join(f'{name}=NUMBER' for name in FIGURES)} with 0 m or more"
)


@dataclass(frozen=True, slots=True)
class Limit:
    """A limit by its word: no event of a kind (`bound` is NaN), or a bound of a figure (m)."""

    word: str
    bound: float = nan

    def __str__(self) -> str:
        return self.word if self.word in EVENTS else f"{self.word}={self.bound:g}"

    @property
    def is_event(self) -> bool:
        """Whether it forbids an event, rather than bounding a figure."""
        return self.word in EVENTS

    def broken_by(self, summary: RunSummary) -> bool:
        """Tell whether any follower of the run broke it."""
        if self.word in EVENTS:
            return any(event.kind == EVENTS[self.word] for event in summary.events)
        return self.severity(summary) > 0.0

    def severity(self, summary: RunSummary) -> float:
        """How far the run is beyond the bound (m): 0 at it, negative while it holds.

        Of events: 1 if there was one, else 0.
        """
        if self.word in EVENTS:
            return float(self.broken_by(summary))
        values = [getattr(row, FIGURES[self.word]) for row in summary.vehicles]
        known = [value for value in values if value is not None]
        if self.word == "gap_m":
            return self.bound - min(known, default=inf)
        return max(known, default=0.0) - self.bound


def parsed_limit(text: str) -> Limit:
    """Read a limit as it is given on the command line; raises ScenarioError."""
    word, _, number = text.partition("=")
    if word in EVENTS and not number:
        return Limit(word)
    try:
        bound = float(number)
    except ValueError:
        bound = nan
    if word in FIGURES and isfinite(bound) and bound >= 0.0:
        return Limit(word, bound)
    raise ScenarioError([f"--limit: given {text!r}, allowed {ALLOWED}"])
