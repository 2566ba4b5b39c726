"""Covariance of a pose estimate, and how it grows and shrinks: two small Kalman filters.

In the frame of the body, errors along it and across it are estimated apart from one another: the
position error is alike in both to begin with, and what they have in common afterwards (a turn of
the body by half a radian while an error lasts) is left out. All formulas are written out; an error
is true value minus estimate.

A gain is the covariance of the measured state with the one to correct, over the variance of the
measured state and that of the measurement.
"""

from dataclasses import dataclass

EXACT = 1.0, 0.0, 0.0
"""Gains of a measurement without noise, of a state that is known exactly: taken over as it is."""


@dataclass(slots=True)
class AlongCovariance:
    """Covariance of the place along the body (a, m) and the speed's bias (s, m/s); a' = -s.

    Source: Kalman, Journal of Basic Engineering 82, 1960.
    """

    aa: float
    ss: float
    sa: float = 0.0

    def grow(self, span: float, density: float) -> None:
        """Predict over `span` (s), with a random walk of `density` (m²/s)."""
        self.aa += span * (density + span * self.ss - 2.0 * self.sa)
        self.sa -= span * self.ss

    def by_place(self, innovation: float, variance: float) -> tuple[float, float]:
        """Correct by a measured place; returns the corrections of place and bias."""
        total = self.aa + variance
        gain, bias_gain = (self.aa / total, self.sa / total) if total > 0.0 else EXACT[:2]
        ss = self.ss - bias_gain * self.sa
        self.ss = 0.0 if ss < 0.0 else ss
        self.sa *= 1.0 - gain
        self.aa *= 1.0 - gain
        return gain * innovation, bias_gain * innovation

    def by_bias(self, innovation: float, variance: float) -> tuple[float, float]:
        """Correct by a measured bias; returns the corrections of place and bias."""
        total = self.ss + variance
        gain, place_gain = (self.ss / total, self.sa / total) if total > 0.0 else EXACT[:2]
        aa = self.aa - place_gain * self.sa
        self.aa = 0.0 if aa < 0.0 else aa
        self.sa *= 1.0 - gain
        self.ss *= 1.0 - gain
        return place_gain * innovation, gain * innovation


@dataclass(slots=True)
class AcrossCovariance:
    """Covariance of place across the body (c, m), heading (h, rad) and gyroscope bias (g, rad/s).

    c' = v h + l h', h' = -g with the speed v and the steady slip per yaw rate l.
    Source: Kalman, Journal of Basic Engineering 82, 1960.
    """

    cc: float
    hh: float
    gg: float
    hc: float = 0.0
    gc: float = 0.0
    gh: float = 0.0

    def grow(
        self, span: float, distance: float, slip: float, across: float, heading: float
    ) -> None:
        """Predict over `span` (s) and `distance` (m), at `slip` l (m).

        With random walks of density `across` (m²/s) and of `heading` (rad²/s).
        """
        across, heading = across * span, heading * span
        g, gh = -span * (0.5 * distance + slip), self.gh
        hc = self.hc + distance * self.hh + g * gh
        gc = self.gc + distance * gh + g * self.gg
        self.cc += (
            distance * (self.hc + hc) + g * (self.gc + gc) + across + distance**2 * heading / 3.0
        )
        self.hc = hc - span * gc + 0.5 * distance * heading
        self.gc = gc
        self.hh += span * (span * self.gg - 2.0 * gh) + heading
        self.gh = gh - span * self.gg

    def by_place(self, innovation: float, variance: float) -> tuple[float, float, float]:
        """Correct by a measured place; returns the corrections of place, heading, bias."""
        total = self.cc + variance
        c, h, g = (self.cc / total, self.hc / total, self.gc / total) if total > 0.0 else EXACT
        hh = self.hh - h * self.hc
        self.hh = 0.0 if hh < 0.0 else hh
        self.gh -= h * self.gc
        gg = self.gg - g * self.gc
        self.gg = 0.0 if gg < 0.0 else gg
        self.hc *= 1.0 - c
        self.gc *= 1.0 - c
        self.cc *= 1.0 - c
        return c * innovation, h * innovation, g * innovation

    def by_heading(self, innovation: float, variance: float) -> tuple[float, float, float]:
        """Correct by a measured heading; returns as `by_place`."""
        total = self.hh + variance
        h, c, g = (self.hh / total, self.hc / total, self.gh / total) if total > 0.0 else EXACT
        cc = self.cc - c * self.hc
        self.cc = 0.0 if cc < 0.0 else cc
        self.gc -= c * self.gh
        gg = self.gg - g * self.gh
        self.gg = 0.0 if gg < 0.0 else gg
        self.hc *= 1.0 - h
        self.gh *= 1.0 - h
        self.hh *= 1.0 - h
        return c * innovation, h * innovation, g * innovation

    def by_bias(self, innovation: float, variance: float) -> tuple[float, float, float]:
        """Correct by a measured bias of the gyroscope; returns as `by_place`."""
        total = self.gg + variance
        g, c, h = (self.gg / total, self.gc / total, self.gh / total) if total > 0.0 else EXACT
        cc = self.cc - c * self.gc
        self.cc = 0.0 if cc < 0.0 else cc
        self.hc -= c * self.gh
        hh = self.hh - h * self.gh
        self.hh = 0.0 if hh < 0.0 else hh
        self.gc *= 1.0 - g
        self.gh *= 1.0 - g
        self.gg *= 1.0 - g
        return c * innovation, h * innovation, g * innovation
