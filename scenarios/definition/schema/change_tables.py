"""What a scenario file may say is done to a running convoy: to its links and to its vehicles.

The same tables are asked for by hand while a convoy runs, and stand in its log.
"""

from typing import Annotated, Literal

from pydantic import Field

from scenarios.definition.schema.base_table import Name, Ratio, Speed, Table

LATEST_S = 86_400


class ChangeTable(Table):
    """Something done `at_s` after the start of the run."""

    at_s: float = Field(ge=0, le=LATEST_S)


class LinkChangeTable(ChangeTable):
    """Links of another quality for what is sent from `at_s` on, until `for_s` later or the next.

    Each end is a vehicle's name, a role ("lead", "predecessor", "follower"), or "*" for any. A key
    that is left out stays as it is.
    """

    kind: Literal["link"]
    sender: str = "*"
    receiver: str = "*"
    for_s: float | None = Field(default=None, gt=0, le=LATEST_S)
    loss_ratio: Ratio | None = None
    latency_ms: float | None = Field(default=None, ge=0, le=60_000)
    jitter_ms: float | None = Field(default=None, ge=0, le=60_000)


class CutTable(ChangeTable):
    """Links that carry nothing of what is sent from `at_s` on, until `for_s` later or healed."""

    kind: Literal["cut"]
    sender: str = "*"
    receiver: str = "*"
    for_s: float | None = Field(default=None, gt=0, le=LATEST_S)


class HealTable(ChangeTable):
    """Links as the scenario has them again: nothing that was changed before counts any more."""

    kind: Literal["heal"]
    sender: str = "*"
    receiver: str = "*"


class VehicleChangeTable(ChangeTable):
    """Something done to one vehicle, at its first tick from `at_s` on."""

    vehicle: Name


class FixChangeTable(VehicleChangeTable):
    """Its receiver has this fix, until `for_s` later; "auto" gives it back to its own law."""

    kind: Literal["gnss"]
    fix: Literal["fixed", "float", "single", "none", "auto"]
    for_s: float | None = Field(default=None, gt=0, le=LATEST_S)


class StallTable(VehicleChangeTable):
    """Its control does not run for `for_s`: it hears, decides and sends nothing.

    The car keeps the command that it was given last.
    """

    kind: Literal["stall"]
    for_s: float = Field(gt=0, le=LATEST_S)


class CrashTable(VehicleChangeTable):
    """Its process ends, and starts anew `for_s` later, without memory; never, without `for_s`.

    Meanwhile the car brakes to a standstill with its wheels as they were.
    """

    kind: Literal["crash"]
    for_s: float | None = Field(default=None, ge=1, le=LATEST_S)


class LeaveTable(VehicleChangeTable):
    """Its driver takes over: it sends nothing any more and drives on by itself."""

    kind: Literal["leave"]


class JoinTable(VehicleChangeTable):
    """It joins the convoy: until then its driver drives it, and it sends nothing."""

    kind: Literal["join"]


class SpeedChangeTable(ChangeTable):
    """The lead drives at another set speed from `at_s` on, which it comes to at this acceleration.

    So do followers that drive the same speed at the same time: of this they are told. Followers
    that keep a gap find out by themselves.
    """

    kind: Literal["speed"]
    speed_mps: Speed
    acceleration_mps2: float = Field(default=1.5, ge=0.1, le=12)


AnyChange = Annotated[
    LinkChangeTable
    | CutTable
    | HealTable
    | FixChangeTable
    | StallTable
    | CrashTable
    | LeaveTable
    | JoinTable
    | SpeedChangeTable,
    Field(discriminator="kind"),
]
Changes = Annotated[tuple[AnyChange, ...], Field(strict=False)]
