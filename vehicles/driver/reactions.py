"""Reactions of a follower to missing data: interface, and the shipped classes."""

from dataclasses import replace
from typing import ClassVar, Protocol

from vehicles.driver.situation import Situation
from vehicles.driver.steering import SteeringCommand
from vehicles.messages import Mode

CHOSEN: tuple[Mode, ...] = ("coast", "stop", "straight")
"""Modes that a policy may choose instead of the usual one."""


class ReactionPolicy(Protocol):
    """Interface of a degradation policy, shipped or user-defined.

    Each follower has its own instance, constructed as `Class()`, with its parameters.
    `mode`, `steering` and `acceleration` are called once per control instant, in this order. They
    must not use a clock. A class that inherits from `Extrapolate` of `vehicles.driver.reactions`
    replaces the shipped policy: only impossible jumps are rejected, and the law of the speed is not
    overridden. A class that inherits from `Degrade` adds to it: implausible poses are rejected,
    and the car brakes where evidence requires it and stops within the known path.

    `mode` returns the usual mode or one of `CHOSEN`; in a chosen mode the last trajectory is kept.
    """

    degrades: ClassVar[bool]

    def mode(self, situation: Situation, usual: Mode, speed: float) -> Mode:
        """Mode to steer in, given the `usual` one, at `speed` (m/s).

        "stop" warns the followers behind. Without `Degrade`, the usual mode is that of the sources
        whose samples reach ahead of the car.
        """
        ...

    def steering(
        self, mode: Mode, command: SteeringCommand, last: SteeringCommand
    ) -> SteeringCommand:
        """Steering command, given that of the controller and the `last` one."""
        ...

    def acceleration(self, situation: Situation, mode: Mode, speed: float, wanted: float) -> float:
        """Acceleration (m/s²) at `speed` (m/s), given the `wanted` one.

        `situation.lead`, `situation.predecessor` and the values of `situation.others`, by the names
        of all other sources, have the attributes `status`, `age` and `silence` (s), `known` (m of
        path), `speed` (m/s), `acceleration` (m/s², commanded) and `achieved` (m/s²), `mode` and
        `hazard`; numbers are NaN before the first message. `situation.known` is the known path
        ahead (m), `situation.ahead` the `VehiclesAhead` of the longitudinal controller.
        """
        ...


class Extrapolate:
    """Continue along the last trajectory at full speed."""

    degrades: ClassVar[bool] = False

    def mode(self, situation: Situation, usual: Mode, speed: float) -> Mode:
        return usual

    def steering(
        self, mode: Mode, command: SteeringCommand, last: SteeringCommand
    ) -> SteeringCommand:
        return command

    def acceleration(self, situation: Situation, mode: Mode, speed: float, wanted: float) -> float:
        return wanted


class Degrade(Extrapolate):
    """Drive on by what was received, brake where evidence requires it, and stop."""

    degrades: ClassVar[bool] = True


class Hold(Extrapolate):
    """Keep the last steering command, at full speed."""

    def steering(
        self, mode: Mode, command: SteeringCommand, last: SteeringCommand
    ) -> SteeringCommand:
        return last if mode == "coast" else command


class Straight(Extrapolate):
    """Turn the wheels straight, at full speed, as the guardian of the Apollo system does."""

    def steering(
        self, mode: Mode, command: SteeringCommand, last: SteeringCommand
    ) -> SteeringCommand:
        if mode != "coast":
            return command
        return replace(command, steering=0.0, feedforward=0.0, feedback=0.0)
