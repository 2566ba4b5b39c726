"""Panels of the picture in Rerun as a table."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from vehicles.schedule import MILLISECOND

# ---- Colours of the vehicles, the same in every picture


Colour = tuple[int, int, int]

COLOURS: tuple[Colour, ...] = (
    (0xE4, 0x57, 0x2E),
    (0x56, 0xB4, 0xE9),
    (0x1F, 0xA9, 0x7F),
    (0xE6, 0x9F, 0x00),
    (0xE8, 0x90, 0xC8),
    (0x70, 0x78, 0xFF),
    (0xD8, 0xD8, 0x2A),
    (0x9A, 0x9A, 0x9A),
    (0x8A, 0x4B, 0x20),
    (0x84, 0xD0, 0x30),
    (0xA0, 0x30, 0xD8),
    (0x1F, 0x70, 0xA0),
)
"""Colours of the lead and its followers, readable on dark and light backgrounds.

Any two of them are at least 0.12 apart in Oklab (Ottosson 2020).
"""


ROAD: Colour = (0x6A, 0x6A, 0x6A)


def colour_of(place: int) -> Colour:
    """Colour of the vehicle at `place` of the convoy; after twelve they repeat, darker."""
    if place == 0:
        return COLOURS[0]
    round_, place = divmod(place - 1, len(COLOURS) - 1)
    return shaded(COLOURS[1 + place], (1.0, 0.6, 0.8)[round_ % 3])


def colours_of_sources(place: int) -> list[Colour]:
    """Colours of the sources of the vehicle at `place`: the lead, then the k-th vehicle ahead."""
    return [colour_of(0), *(colour_of(max(place - ahead, 0)) for ahead in range(1, place + 1))]


def shaded(colour: Colour, brightness_ratio: float) -> Colour:
    red, green, blue = (round(brightness_ratio * part) for part in colour)
    return red, green, blue


# ---- Panels


CURVE_NS = 40 * MILLISECOND
SLOW_CURVE_NS = 200 * MILLISECOND

OK, LATE, SILENT = "ok", "late", "silent"
LOSSES = tuple(f"{tenth}0 % lost" for tenth in range(1, 11))
"""States of a link over half a second by the share lost: to the nearest tenth, 100 % only if all
messages were lost."""
STATE_GREEN, STATE_BLUE, STATE_PURPLE = (0x2E, 0x4A, 0x44), (0x3F, 0x44, 0x7E), (0x4F, 0x25, 0x66)
STATE_BROWN, STATE_RED = (0x5C, 0x4A, 0x36), (0xB0, 0x10, 0x3C)
STATE_AMBER, STATE_TEAL = (0x8A, 0x5A, 0x10), (0x2A, 0x4C, 0x66)
STATE_OLIVE = (0x55, 0x5C, 0x22)


@dataclass(frozen=True, slots=True)
class Series:
    """One curve or strip of states of each vehicle.

    Its values are those of `field` in the log's messages of `topic`. The picture itself computes
    the values of series without a field and of topics that the bus does not carry. `name`
    distinguishes the series of a vehicle; `label`, `colour` and `width` are those of its curve, by
    default the vehicle's colour times `brightness_ratio`. The field `deviation` is the standard
    deviation of the value; a band of three of them is drawn. A state becomes "<state>, <flag>"
    while the Boolean field `flag` is true. `first_follower` is False for series that the first
    follower lacks: its predecessor is the lead. A series of `each_other` is one for each source
    that is neither lead nor predecessor, with its name; `field` has their values as a list.
    """

    topic: str = ""
    field: str = ""
    name: str = ""
    label: str = ""
    colour: Colour | None = None
    brightness_ratio: float = 1.0
    width: float = 1.5
    flag: str = ""
    deviation: str = ""
    first_follower: bool = True
    each_other: bool = False

    def colour_at(self, place: int) -> Colour:
        return self.colour or shaded(colour_of(place), self.brightness_ratio)

    def label_of(self, vehicle: str) -> str:
        return self.label or f"{vehicle} {self.name}".rstrip()


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """Contents of a panel and its vehicles.

    `kind` is a plot of all vehicles, one plot for each follower, or strips of states with the
    colours `states`. Values are drawn in `unit`, `factor` times those of the messages, every
    `period_ns` (0: each of them). A vehicle that is not drawn in detail has no series, except in a
    panel of `every_vehicle`. `lead` states whether the lead has series and whether the panel shows
    them. `marked` plots show the events.
    """

    name: str
    title: str
    kind: Literal["plot", "plot_of_one", "states"]
    series: tuple[Series, ...] = (Series(),)
    unit: str = ""
    factor: float = 1.0
    period_ns: int = 0
    lead: Literal["absent", "hidden", "shown"] = "absent"
    every_vehicle: bool = False
    states: Mapping[str, Colour] = field(default_factory=dict)
    marked: bool = False

    @property
    def topic(self) -> str:
        """Topic of the messages that hold the values, empty if the picture computes them."""
        return self.series[0].topic

    def heading(self, vehicle: str) -> str:
        """Title with the unit; `vehicle` is part of it if each follower has its own panel."""
        title = self.title.format(vehicle=vehicle)
        return f"{title} ({self.unit})" if self.unit else title


@dataclass(frozen=True, slots=True)
class Row:
    """Panels that share a place as tabs, and the share of the height that it takes.

    The panels of states named in `joint` share one view in a short convoy.
    """

    share: int
    panels: tuple[Panel, ...]
    joint: tuple[str, ...] = ()


def flagged(state: str, flag: str) -> str:
    """State of a vehicle while a flag, such as "hazard", is raised."""
    return f"{state}, {flag}"


def _loss_colour(share: float) -> Colour:
    """Shade a share lost from brown to crimson."""
    red, green, blue = (
        round(least + share * (most - least))
        for least, most in zip(STATE_BROWN, STATE_RED, strict=True)
    )
    return red, green, blue


_MODES = {
    "path": (0x4A, 0x4A, 0x4A),
    "composite": STATE_GREEN,
    "lead": STATE_TEAL,
    "predecessor": STATE_BROWN,
    "intermediate": STATE_OLIVE,
    "coast": STATE_AMBER,
    "stop": STATE_RED,
    "straight": STATE_PURPLE,
}

# Colours of states are dark, and so differ from the colours of the cars.
# fmt: off
ROWS = (
    Row(4, (
        Panel(
            name="cross_track", title="True cross-track error", unit="m, left positive",
            kind="plot", series=(Series("deviation", "cross_track_error_m"),),
            marked=True,
        ),
        Panel(
            name="tracking", title="Self-estimated error, ± 3σ of the position", unit="m",
            kind="plot",
            series=(Series("tracking", "lateral_error_m", deviation="lateral_deviation_m"),),
            lead="shown",
        ),
        Panel(
            name="steering", title="Steering", unit="deg",
            kind="plot", series=(Series("command", "steering_rad"),), factor=math.degrees(1.0),
            period_ns=CURVE_NS, lead="shown",
        ),
    )),
    Row(4, (
        Panel(
            name="closing", title="Road ahead of {vehicle}", unit="m",
            kind="plot_of_one",
            series=(
                Series("tracking", "blind_m", name="blind",
                       label="blind distance of a stop", colour=(0xD0, 0x40, 0x40)),
                Series("tracking", "known_m", name="known",
                       label="known path", colour=(0x2F, 0x8C, 0xFF), width=2.5),
            ),
            period_ns=CURVE_NS, marked=True,
        ),
        Panel(
            name="age", title="Pose age, lead bright, others dark", unit="s",
            kind="plot",
            series=(
                Series("tracking", "lead_age_s", name="lead"),
                Series("tracking", "predecessor_age_s", name="predecessor",
                       brightness_ratio=0.6, first_follower=False),
                Series("tracking", "other_age_s", brightness_ratio=0.4, each_other=True),
            ),
            period_ns=SLOW_CURVE_NS,
        ),
        Panel(
            name="received", title="Received in the last 10 s", unit="%",
            kind="plot",
            series=(
                Series("tracking", "lead_received_ratio", name="lead"),
                Series("tracking", "predecessor_received_ratio", name="predecessor",
                       brightness_ratio=0.6, first_follower=False),
                Series("tracking", "other_received_ratio", brightness_ratio=0.4, each_other=True),
            ),
            factor=100.0, period_ns=SLOW_CURVE_NS,
        ),
        Panel(
            name="weight", title="Weight of the predecessor", unit="%",
            kind="plot", series=(Series("tracking", "predecessor_weight_ratio"),),
            factor=100.0, period_ns=SLOW_CURVE_NS,
        ),
        Panel(
            name="loss", title="Loss by half second", unit="%",
            kind="plot", factor=100.0,
        ),
    )),
    Row(4, (
        Panel(
            name="true_gap", title="Gap, true", unit="m",
            kind="plot", series=(Series("deviation", "true_gap_m"),),
            marked=True,
        ),
        Panel(
            name="gap", title="Gap, estimated bright, measured dark", unit="m",
            kind="plot",
            series=(
                Series("tracking", "estimated_gap_m"),
                Series("tracking", "measured_gap_m", name="measured", brightness_ratio=0.6),
            ),

        ),
        Panel(
            name="speed", title="Speed", unit="m/s",
            kind="plot", series=(Series("truth", "speed_mps"),),
            period_ns=SLOW_CURVE_NS, lead="shown",
        ),
    )),
    Row(9, (
        Panel(
            name="links", title="Links",
            kind="states",
            states={
                OK: STATE_GREEN,
                LATE: STATE_BLUE,
                **{state: _loss_colour(k / 9.0) for k, state in enumerate(LOSSES)},
                SILENT: STATE_PURPLE,
            },
        ),
        Panel(
            name="mode", title="Modes",
            kind="states", series=(Series("tracking", "mode", flag="hazard"),),
            states=_MODES | {flagged(mode, "hazard"): _MODES[mode] for mode in _MODES},
            lead="hidden", every_vehicle=True,
        ),
        Panel(
            name="sources", title="Status of the sources",
            kind="states",
            series=(
                Series("tracking", "lead_status", name="lead"),
                Series("tracking", "predecessor_status", name="predecessor", first_follower=False),
                Series("tracking", "other_sources", each_other=True),
            ),
            states={
                "unheard": STATE_PURPLE,
                "fresh": STATE_GREEN,
                "late": STATE_BLUE,
                "probation": STATE_TEAL,
                "distrusted": STATE_AMBER,
                "lost": STATE_RED,
                "unused": STATE_BROWN,
            },
        ),
        Panel(
            name="messages", title="Messages (zoom in)",
            kind="states", states={OK: STATE_GREEN, LATE: STATE_BLUE, "lost": STATE_RED},
        ),
    ), joint=("links", "mode")),
)
# fmt: on
PANELS: Mapping[str, Panel] = {panel.name: panel for row in ROWS for panel in row.panels}
