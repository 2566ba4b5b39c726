"""What a scenario file may say of when a vehicle sends."""

from typing import Annotated, Literal

from pydantic import Field

from scenarios.definition.schema.table import NotNegative, Ratio, Table

Interval = Annotated[float, Field(ge=10, le=60_000)]
Hertz = Annotated[float, Field(ge=0.01, le=100)]


class BusyPoint(Table):
    """The channel busy ratio from a time after the start on."""

    at_s: NotNegative
    busy_ratio: Ratio


class DccTable(Table):
    """Reactive congestion control (ETSI TS 102 687 V1.2.1, Annex A.1): the busier, the rarer.

    The busy ratio is looked at every `period_ms`; it is 0 before the first entry of `busy`.
    """

    busy: Annotated[tuple[BusyPoint, ...], Field(strict=False, min_length=1)]
    period_ms: float = Field(default=100.0, ge=10, le=10_000)


class SendingBase(Table):
    """What all rules have in common: congestion control, if any."""

    dcc: DccTable | None = None


class EveryFixSending(SendingBase):
    """Each fix is sent as soon as it is known."""

    kind: Literal["every_fix"] = "every_fix"


class FixedSending(SendingBase):
    """At `rate_hz`, the first time `phase_s` after the start, or after a part of a period drawn."""

    kind: Literal["fixed"]
    rate_hz: Hertz
    phase_s: NotNegative = 0.0
    drawn_phase: bool = False


class SendingRatePoint(Table):
    """The rate of sending from a time after the start on; 0: nothing is sent."""

    at_s: NotNegative
    rate_hz: float = Field(ge=0, le=100)


class ProfileSending(SendingBase):
    """At a rate that changes; before the first entry nothing is sent."""

    kind: Literal["profile"]
    profile: Annotated[tuple[SendingRatePoint, ...], Field(strict=False, min_length=1)]


class CamSending(SendingBase):
    """By the rule of cooperative awareness messages (ETSI EN 302 637-2, Section 6.1.3).

    It is looked at every `check_period_ms`, the first time `phase_s` after the start, or after a
    part of that period drawn.
    """

    kind: Literal["cam"]
    check_period_ms: float = Field(default=100.0, ge=1, le=100)
    phase_s: NotNegative = 0.0
    drawn_phase: bool = False


class IntervalsSending(SendingBase):
    """At intervals drawn from a `table` that was measured, or from `intervals_ms` by their shares.

    Normal jitter of deviation `jitter_ms` about them, cut at three deviations.
    """

    kind: Literal["intervals"]
    table: Literal["cam_vw_highway", "cam_renault_highway"] | None = None
    intervals_ms: Annotated[tuple[Interval, ...], Field(strict=False)] = ()
    shares_ratio: Annotated[tuple[Ratio, ...], Field(strict=False)] = ()
    jitter_ms: float = Field(default=3.0, ge=0, le=1000)


SendingTable = Annotated[
    EveryFixSending | FixedSending | ProfileSending | CamSending | IntervalsSending,
    Field(discriminator="kind"),
]

CAM_INTERVALS_MS = tuple(100.0 * k for k in range(1, 11))
CAM_SHARES = {
    "cam_vw_highway": (0.035, 0.333, 0.141, 0.389, 0.018, 0.060, 0.004, 0.004, 0.001, 0.016),
    "cam_renault_highway": (0.056, 0.184, 0.145, 0.194, 0.174, 0.098, 0.038, 0.020, 0.007, 0.083),
}
"""Shares of the intervals between cooperative awareness messages of two makers' cars on highways
(R. Molina-Masegosa, M. Sepulcre, J. Gozalvez, F. Berens, V. Martinez, "Empirical models for the
realistic generation of cooperative awareness messages in vehicular networks", IEEE TVT 69(5), 2020,
arXiv 2004.06919). Rounded there, so they add up to 1 but for a thousandth."""
