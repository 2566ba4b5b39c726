"""What a scenario file may say of what the log of a run holds."""

from typing import Annotated

from pydantic import Field

from scenarios.definition.schema.base_table import Table

LoggedRate = Annotated[float, Field(ge=0, le=1000)]


class LogTable(Table):
    """How many messages a second of each vehicle the log holds at most, by topic.

    0 means none, and without the key it holds all of them. The figures of a run are of all either
    way, but for what is worked out later from the log.
    """

    truth_rate_hz: LoggedRate | None = None
    trajectory_rate_hz: LoggedRate | None = None
    tracking_rate_hz: LoggedRate | None = None
    command_rate_hz: LoggedRate | None = None
    verdicts: bool = True

    @property
    def rates_hz(self) -> dict[str, float]:
        """Highest rate of each topic that is not logged whole."""
        rates = {
            "truth": self.truth_rate_hz,
            "trajectory": self.trajectory_rate_hz,
            "tracking": self.tracking_rate_hz,
            "command": self.command_rate_hz,
            "verdict": None if self.verdicts else 0.0,
        }
        return {topic: rate for topic, rate in rates.items() if rate is not None}
