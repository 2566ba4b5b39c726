"""A cut of links in a convoy, and its scenario."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal, get_args

import numpy as np
import tomli_w

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.studies.cuts.roads import TABLES, Road

Variant = Literal["degrade", "extrapolate", "hold", "straight", "history", "no_history"]
"""What is compared: reactions of followers, or poses with and without path history."""
Links = Literal["all", "lead", "link", "vehicle"]
"""Links that are cut: all, those from the lead, one from a predecessor, or all of one vehicle."""
LINKS: tuple[Links, ...] = get_args(Links)
Fix = Literal["", "float", "none"]
"""Fix state of a failing receiver; empty if none fails."""

AFTERWARDS_S = 15.0
"""Duration of the run after the cut."""
FOR_GOOD_S = 14.0
"""Duration of the run after a permanent cut begins: all cars have stopped by then."""
FLAPPING_S = 0.2, 1.2
"""Range of the times for which flapping links are cut, and restored."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkCut:
    """Links of a convoy are cut at `at_s` (after the start) for `for_s`, or permanently if None.

    `flapping` links are cut and restored at random times meanwhile. `vehicle` is the number of the
    car that is cut off, or that receives nothing from its predecessor, and of the one whose
    receiver fails at `at_s` for `for_s`.
    """

    variant: Variant
    road: Road = "lane_change"
    speed_mps: float
    at_s: float
    for_s: float | None
    seed: int
    vehicles: int = 3
    links: Links = "all"
    flapping: bool = False
    vehicle: int = 2
    fix: Fix = ""

    @property
    def ends_at_s(self) -> float:
        """End of the cut; that of the run if the cut is permanent."""
        return self.at_s + (FOR_GOOD_S if self.for_s is None else self.for_s)

    def scenario(self) -> Scenario:
        return scenario_from_text(self.text(), label="cut")

    def text(self) -> str:
        """Content of the scenario file."""
        road = TABLES[self.road](self.speed_mps)
        control = {**road.get("control", {}), "degradation": {"reaction": self._reaction}}
        text = {
            **road,
            "name": "cut",
            "duration_s": self.ends_at_s + (0.0 if self.for_s is None else AFTERWARDS_S),
            "seed": self.seed,
            "convoy": {"vehicles": self.vehicles},
            "control": control,
            "change": [*self._cuts(), *self._failure()],
        }
        if self.variant == "no_history":
            text["sending"] = {"path_history_m": 0.0}
        return tomli_w.dumps(text)

    @property
    def _reaction(self) -> str:
        return "degrade" if self.variant in {"history", "no_history"} else self.variant

    def _cuts(self) -> Iterator[Mapping[str, Any]]:
        name, ahead = f"v{self.vehicle}", f"v{self.vehicle - 1}"
        nobody_behind = self.vehicle == self.vehicles and self.road != "church_lot"
        ends: Mapping[Links, Sequence[Mapping[str, str]]] = {
            "all": [{}],
            "lead": [{"sender": "v1"}],
            "link": [{"sender": ahead, "receiver": name}],
            "vehicle": ({"sender": name}, {"receiver": name})[nobody_behind:],
        }
        for span, links in product(self._spans(), ends[self.links]):
            yield {"kind": "cut", **span, **links}

    def _spans(self) -> Iterator[Mapping[str, float]]:
        if not self.flapping:
            yield {"at_s": self.at_s} | ({} if self.for_s is None else {"for_s": self.for_s})
            return
        random, at_s = np.random.Generator(np.random.PCG64(self.seed)), self.at_s
        while (left_s := round(self.ends_at_s - at_s, 3)) > 0.0:
            cut_s, restored_s = (round(float(span), 3) for span in random.uniform(*FLAPPING_S, 2))
            yield {"at_s": round(at_s, 3), "for_s": min(cut_s, left_s)}
            at_s += cut_s + restored_s

    def _failure(self) -> Iterator[Mapping[str, Any]]:
        if self.fix:
            vehicle, at_s = f"v{self.vehicle}", self.at_s
            for_s = {} if self.for_s is None else {"for_s": self.for_s}
            yield {"kind": "gnss", "vehicle": vehicle, "fix": self.fix, "at_s": at_s, **for_s}
