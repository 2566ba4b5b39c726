"""The table of the log."""

from typing import Annotated

from pydantic import Field

from scenarios.definition.schema.base_table import Table

LoggedRate = Annotated[float, Field(ge=0, le=1000)]


class LogTable(Table):
    """Largest rates of messages in the log, per vehicle. Omitted: no limit. 0: nothing is logged.

    The summary counts all messages in any case. Trajectories and commands that are not logged are
    not sent, so the live viewer does not show them.

    truth_rate_hz       true poses
    trajectory_rate_hz  fitted trajectories
    tracking_rate_hz    tracking errors
    command_rate_hz     commands
    verdicts            whether the verdict of each link on each message is logged
    """

    truth_rate_hz: LoggedRate | None = None
    trajectory_rate_hz: LoggedRate | None = None
    tracking_rate_hz: LoggedRate | None = None
    command_rate_hz: LoggedRate | None = None
    verdicts: bool = True

    @property
    def rates_hz(self) -> dict[str, float]:
        """Largest rate by topic, for topics that are not logged completely."""
        rates = {
            "truth": self.truth_rate_hz,
            "trajectory": self.trajectory_rate_hz,
            "tracking": self.tracking_rate_hz,
            "command": self.command_rate_hz,
            "verdict": None if self.verdicts else 0.0,
        }
        return {topic: rate for topic, rate in rates.items() if rate is not None}
