"""Style of the pictures: colour-blind-safe colours and matplotlib's settings.

Does not import matplotlib. Figures are made without pyplot, so no global state is touched and no
display is needed.
"""

from typing import Any

BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
    "#666666",
)
"""Okabe and Ito's palette."""

SEQUENCE = "viridis"
"""Colour map for ordered values."""

STYLE: Any = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.6,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "figure.dpi": 150.0,
    "savefig.dpi": 150.0,
}
