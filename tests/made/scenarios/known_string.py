"""A convoy of known speeds, gaps and lateral errors on a straight road, as tables of a run."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from random import Random

import numpy as np
from numpy.typing import NDArray

from scenarios.results.string_figures import StringFigures, string_figures
from scenarios.results.tables import RunTables
from tests.made.scenarios.messages import truth
from tests.made.scenarios.tables import LENGTH, run_of
from vehicles.messages import Message, TruePose

Floats = NDArray[np.float64]
STEP, SPEED, HEADWAY, STANDSTILL = 0.02, 20.0, 0.5, 6.0
NAMES = ("v1", "v2", "v3", "v4")


class KnownString:
    """Stations and speeds of vehicles over time, and lateral errors over the station."""

    def __init__(self, speeds: Sequence[Floats], gaps: Sequence[Floats] = ()) -> None:
        """`speeds` (m/s) by vehicle, and errors of the gaps (m) of the followers."""
        self.speeds = speeds
        lead = np.concatenate([[0.0], STEP * np.cumsum(speeds[0])[:-1]])
        self.stations = [lead]
        for speed, gap in zip(speeds[1:], gaps, strict=False):
            self.stations.append(self.stations[-1] - STANDSTILL - HEADWAY * speed - gap)

    def figures(
        self,
        errors: Sequence[Callable[[float], float]] = (),
        deviation: float = 0.0,
        order: Random | None = None,
    ) -> dict[str, StringFigures]:
        """Figures of the convoy; an `order` mixes the messages of different vehicles."""
        run = self.run(errors, order)
        return string_figures(run, dict.fromkeys(run.names, deviation))

    def run(
        self,
        errors: Sequence[Callable[[float], float]] = (),
        order: Random | None = None,
        more: Sequence[Message] = (),
    ) -> RunTables:
        """Tables of the true poses, and of `more` messages."""
        names = NAMES[: len(self.speeds)]
        poses = [self._pose(name, k, errors) for k in range(self.speeds[0].size) for name in names]
        if order:
            order.shuffle(poses)
        policy = {
            "followers": "'gap'",
            "gap.standstill_m": STANDSTILL - LENGTH,
            "gap.headway_s": HEADWAY,
        }
        keys = [f"speed.{key}={value}" for key, value in policy.items()]
        return run_of(*poses, *more, count=len(names), overrides=keys)

    def _pose(self, name: str, k: int, errors: Sequence[Callable[[float], float]]) -> TruePose:
        place = NAMES.index(name)
        station = float(self.stations[place][k])
        lateral = errors[place - 1](station) if place and errors else 0.0
        pose = truth(name, k, station, lateral, distance=station)
        return replace(pose, speed_mps=float(self.speeds[place][k]))
