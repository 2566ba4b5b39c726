"""The table of vehicles that repeat a recorded run."""

from typing import Annotated

from pydantic import Field, StringConstraints

from scenarios.definition.schema.base_table import Name, Table


class ReplayTable(Table):
    """Vehicles that send their messages of a recorded run again; the others are simulated.

    A replayed vehicle sends its recorded poses at their times, and its true poses for the log. It
    receives and decides nothing. Links and their losses act as usual in the receivers. `convoy
    replay` writes this table.

    log         log of the recorded run
    vehicles    names of the replayed vehicles
    partial     whether a damaged or incomplete log is used; its poses are numbered again
    digest      checksum of the log, written by the program; do not set
    recorded_s  first and last recorded time, written by the program; do not set
    """

    log: Annotated[str, StringConstraints(min_length=1)]
    vehicles: Annotated[tuple[Name, ...], Field(strict=False, min_length=1)]
    partial: bool = False
    digest: str = ""
    recorded_s: Annotated[tuple[float, float], Field(strict=False)] | None = None
