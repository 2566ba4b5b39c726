"""Style and file formats of the plots: colour-blind-safe colours, 9 pt at column width.

Figures are made without pyplot, so no global state is touched and no display is needed. Matplotlib
is imported when a figure is encoded.
"""

import errno
import io
import os
from pathlib import Path
from typing import Any

from scenarios.definition.errors import ScenarioError

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


def ink_on(colour: tuple[float, ...]) -> str:
    """Colour of a text that is legible on a background (RGB or RGBA from 0 to 1)."""
    red, green, blue = colour[:3]
    return "black" if 0.299 * red + 0.587 * green + 0.114 * blue > 0.5 else "white"


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


def encoded(figure: Any, picture_format: str) -> bytes:
    from matplotlib import rc_context  # noqa: PLC0415 - an extra

    content = io.BytesIO()
    with rc_context(STYLE):
        figure.savefig(content, format=picture_format, metadata=_METADATA[picture_format])
    return content.getvalue()
