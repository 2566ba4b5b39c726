"""An estimated parameter of a law."""

from dataclasses import dataclass

from scenarios.results.channel.estimates import CONFIDENCE, quantile_of_normal


@dataclass(frozen=True, slots=True)
class Estimate:
    """Estimated value of a link's key, its standard error, and its 95 % interval."""

    key: str
    value: float
    error: float
    low: float
    high: float

    @classmethod
    def normal(
        cls, key: str, value: float, error: float, least: float = 0.0, most: float = float("inf")
    ) -> "Estimate":
        """Build an estimate with a normal interval, clipped to the key's range."""
        half = quantile_of_normal(CONFIDENCE) * error
        return cls(key, value, error, max(least, value - half), min(most, value + half))

    def __str__(self) -> str:
        return f"{self.key} {self.value:.4g} ({self.low:.4g} to {self.high:.4g})"
