"""Style of all Matplotlib figures: colours, sizes and file formats.

Figures are made without pyplot, so no global state is touched and no display is needed. Matplotlib
is imported when a figure is encoded.
"""

import errno
import io
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenarios.definition.errors import ScenarioError
from scenarios.results.files import write_whole
from transport.panels import colour_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# ---- Colours, sizes and fonts

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
MODE_COLOURS: Mapping[str, str] = {
    "path": "#8c8c8c",
    "composite": "#2e9e6b",
    "lead": "#3b82f6",
    "predecessor": "#b0703c",
    "intermediate": "#8f9a1a",
    "coast": "#e08a00",
    "stop": "#e0314f",
    "straight": "#b455c8",
}
"""Colours of the modes, distinct on white and on black."""
SEQUENCE = "viridis"
"""Colour map for ordered values."""
COLUMN_IN, PAGE_IN = 3.5, 7.2
"""Widths (inches) of a column and of a page of two columns."""
SMALL_PT = 7.5
"""Size of numbers in cells and of notes."""
STYLE: Any = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "figure.titlesize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "figure.dpi": 200.0,
    "savefig.dpi": 200.0,
    "svg.hashsalt": "convoy",
    "pdf.fonttype": 42,  # Type 42: journals refuse Type 3
    "ps.fonttype": 42,
}


def vehicle_colour(place: int) -> str:
    """Colour of the vehicle at `place` in the convoy, the lead at 0, as in every picture."""
    return "#{:02x}{:02x}{:02x}".format(*colour_of(place))


# ---- Files

PICTURE_FORMATS = ("png", "svg", "pdf")
_METADATA: dict[str, dict[str, str | None]] = {
    "png": {"Software": ""},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}
"""Without times and versions: equal figures give equal bytes."""


def picture_format_of(path: Path) -> str:
    """Format by the extension of a file; raises ScenarioError for any other extension."""
    picture_format = path.suffix.lower().removeprefix(".")
    if picture_format not in PICTURE_FORMATS:
        allowed = ", ".join(f".{one}" for one in PICTURE_FORMATS)
        raise ScenarioError([f"{path}: given {path.suffix or 'no extension'}, allowed {allowed}"])
    return picture_format


def require_new_picture(path: Path) -> None:
    """Raise ScenarioError or FileExistsError early if no picture can be written to `path`."""
    picture_format_of(path)
    if path.exists():
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))


def encoded(figure: "Figure", picture_format: str, style: Any = STYLE) -> bytes:
    from matplotlib import rc_context  # noqa: PLC0415 - commands without figures start faster

    content = io.BytesIO()
    with rc_context(style):
        figure.savefig(content, format=picture_format, metadata=_METADATA[picture_format])
    return content.getvalue()


def write_picture(figure: "Figure", path: Path) -> None:
    """Write a figure into a new file; raises FileExistsError or ScenarioError."""
    write_whole(path, encoded(figure, picture_format_of(path)), new=True)
