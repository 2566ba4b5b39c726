"""What followers do that do not degrade: to compare with, all of them at full speed."""

from dataclasses import replace
from math import isnan

from vehicles.driver.degradation.machine import NOTHING_HEARD
from vehicles.driver.degradation.pair import SourcePair
from vehicles.driver.degradation.settings import Reaction
from vehicles.driver.degradation.situation import Situation
from vehicles.driver.steering import SteeringCommand
from vehicles.messages import Mode

NO_TRAJECTORY = "no trajectory through what is heard"


class ModesByReach:
    """Steered along is whose samples reach ahead of the car, however old they are.

    Where none do, it coasts: along its last trajectory, or as its reaction is.
    """

    def decide(
        self,
        now: int,  # noqa: ARG002 - all modes are decided alike
        pair: SourcePair,
        situation: Situation,  # noqa: ARG002
        speed: float,  # noqa: ARG002
        *,
        fitted: bool,
        has_path: bool,
    ) -> tuple[Mode, str]:
        """Mode by the windows of the last fit, and who is missing."""
        reaching = [mode for mode, one in pair.used.items() if one.reaches]
        silent = [one for one in pair.used.values() if not one.reaches]
        why = ", ".join(
            f"{one.name} never heard" if isnan(age) else f"{one.name} unheard for {age:.1f} s"
            for one in silent
            for age in [one.freshness.age]
        )
        if not has_path:
            return "straight", NOTHING_HEARD
        if not fitted:
            return "coast", why or NO_TRAJECTORY
        return ("composite" if len(reaching) > 1 else reaching[0]), why


def without_hearing(
    reaction: Reaction, mode: Mode, asked: SteeringCommand, last: SteeringCommand
) -> SteeringCommand:
    """Steering command of a reaction where nobody is heard: the last one, or straight.

    "hold" keeps the `last` command, "straight" turns the wheels straight, as the guardian of the
    Apollo system does; all others steer as `asked` along their trajectory.
    """
    if mode != "coast" or reaction in ("degrade", "extrapolate"):
        return asked
    if reaction == "hold":
        return last
    return replace(asked, steering=0.0, feedforward=0.0, feedback=0.0)
