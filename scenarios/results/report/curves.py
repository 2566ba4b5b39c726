"""Curves of the plots: over time or along the path of the lead, with bands of three sigma."""

from dataclasses import dataclass

import numpy as np

from scenarios.results.recorded.data_table import DataTable
from scenarios.results.report.axes import Floats, Scale, thinned


@dataclass(frozen=True, slots=True)
class Axis:
    """The horizontal axis of a plot: a name and its scale."""

    name: str
    scale: Scale

    @property
    def data(self) -> dict[str, object]:
        """Attributes by which the script of the page finds values under the cursor."""
        low, high = f"{self.scale.low:.9g}", f"{self.scale.high:.9g}"
        return {"data_axis": self.name, "data_from": low, "data_to": high}


@dataclass(frozen=True, slots=True)
class VehicleCurve:
    """Values of one vehicle over time (s), place (m) or frequency (Hz).

    The `deviation` makes a band, `points` are drawn as such.
    """

    name: str
    at: Floats
    values: Floats
    deviation: Floats | None = None
    points: bool = False

    @property
    def is_known(self) -> bool:
        return bool(np.isfinite(self.values).any())

    def band(self) -> tuple[Floats, Floats] | None:
        """Values three standard deviations below and above; None without any."""
        if self.deviation is None or not np.isfinite(self.deviation).any():
            return None
        return self.values - 3.0 * self.deviation, self.values + 3.0 * self.deviation


def along_path(name: str, true: DataTable, figure: str) -> VehicleCurve:
    """A figure over the place along the path of the lead, where the vehicle is there first."""
    known = np.flatnonzero(np.isfinite(true.station_m))
    station = true.station_m[known]
    first = np.diff(np.maximum.accumulate(station), prepend=-np.inf) > 0.0
    return VehicleCurve(name, station[first], true[figure][known][first])


def path_data(x: Floats, y: Floats) -> str:
    """Path of a line in SVG, interrupted where a value is unknown."""
    parts: list[str] = []
    pen = "M"
    for px, py in zip(x.tolist(), y.tolist(), strict=True):
        if not (np.isfinite(px) and np.isfinite(py)):
            pen = "M"
            continue
        parts.append(f"{pen}{px:.1f} {py:.1f}")
        pen = "L"
    return "".join(parts)


def band_data(axis: Axis, scale: Scale, curve: VehicleCurve, most: int) -> str:
    """Area of the band of a curve in SVG, with up to `most` points a side; empty without one.

    Each side keeps its extremes, so that a narrower picture does not narrow the band.
    """
    sides = curve.band()
    if sides is None:
        return ""
    known = np.isfinite(sides[0])
    parts = []
    for rows in np.split(
        np.flatnonzero(known), np.flatnonzero(np.diff(np.flatnonzero(known)) > 1) + 1
    ):
        share = max(int(most * rows.size / known.sum()), 8)
        lines = []
        for side, order in zip(sides, (1, -1), strict=True):
            at, values = thinned(curve.at[rows], side[rows], share)
            x, y = axis.scale.to_pixels(at), np.clip(scale.to_pixels(values), -1e4, 1e4)
            lines.append(path_data(x[::order], y[::order]))
        parts.append(f"{lines[0]}L{lines[1][1:]}z")
    return "".join(parts)
