"""Tables of changes to a running convoy, scheduled or requested live, and as logged."""

from typing import Annotated, Literal

from pydantic import Field

from scenarios.definition.schema.settings_table import Name, Ratio, Speed, Table

LATEST_S = 86_400


class ChangeTable(Table):
    """A change during the run.

    at_s  time after the start of the run
    """

    at_s: float = Field(ge=0, le=LATEST_S)


class LinkChangeTable(ChangeTable):
    """Set the quality of links, for messages sent from `at_s` on. Omitted keys do not change.

    at_s        time after the start of the run
    for_s       duration; without it until healed; a later change of a key replaces it
    sender      a vehicle, a role ("lead", "predecessor", "follower"), or "*" for any vehicle
    receiver    likewise
    loss_ratio  independent loss
    latency_ms  smallest delay
    jitter_ms   additional uniform delay, from 0 to this
    """

    kind: Literal["link"]
    sender: str = "*"
    receiver: str = "*"
    for_s: float | None = Field(default=None, gt=0, le=LATEST_S)
    loss_ratio: Ratio | None = None
    latency_ms: float | None = Field(default=None, ge=0, le=60_000)
    jitter_ms: float | None = Field(default=None, ge=0, le=60_000)


class CutTable(ChangeTable):
    """Cut links: nothing sent from `at_s` on is delivered, for `for_s` or until healed.

    at_s      time after the start of the run
    for_s     duration; without it until healed
    sender    a vehicle, a role, or "*"
    receiver  likewise
    """

    kind: Literal["cut"]
    sender: str = "*"
    receiver: str = "*"
    for_s: float | None = Field(default=None, gt=0, le=LATEST_S)


class HealTable(ChangeTable):
    """Restore links to the scenario's settings.

    at_s      time after the start of the run
    sender    a vehicle, a role, or "*"
    receiver  likewise
    """

    kind: Literal["heal"]
    sender: str = "*"
    receiver: str = "*"


class VehicleChangeTable(ChangeTable):
    """A change of one vehicle, at its first tick from `at_s` on."""

    vehicle: Name


class FixChangeTable(VehicleChangeTable):
    """Set the fix state of a GNSS receiver.

    at_s     time after the start of the run
    for_s    duration; without it until the next change
    vehicle  name of the vehicle
    fix      fix state; "auto" restores the receiver's own law
    """

    kind: Literal["gnss"]
    fix: Literal["fixed", "float", "single", "none", "auto"]
    for_s: float | None = Field(default=None, gt=0, le=LATEST_S)


class StallTable(VehicleChangeTable):
    """Stall the software: it decides and sends nothing, and arriving messages wait.

    The car keeps its last command.

    at_s     time after the start of the run
    for_s    duration
    vehicle  name of the vehicle
    """

    kind: Literal["stall"]
    for_s: float = Field(gt=0, le=LATEST_S)


class CrashTable(VehicleChangeTable):
    """Crash the process of a vehicle; it restarts without data from before the crash.

    Until it restarts, the car brakes with its last steering angle.

    at_s     time after the start of the run
    for_s    time until the restart; without it the vehicle fails (convoy.on_vehicle_failure)
    vehicle  name of the vehicle
    """

    kind: Literal["crash"]
    for_s: float | None = Field(default=None, ge=1, le=LATEST_S)


class LeaveTable(VehicleChangeTable):
    """Let a vehicle leave the convoy: its human driver takes over, and it sends nothing.

    at_s     time after the start of the run
    vehicle  name of the vehicle
    """

    kind: Literal["leave"]


class JoinTable(VehicleChangeTable):
    """Let a vehicle join the convoy. Until then its human driver drives, and it sends nothing.

    at_s     time after the start of the run
    vehicle  name of the vehicle
    """

    kind: Literal["join"]


class SpeedChangeTable(ChangeTable):
    """Change the set speed of the lead, and of followers with speed.followers = "same".

    at_s               time after the start of the run
    speed_mps          new set speed
    acceleration_mps2  acceleration until it is reached
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
