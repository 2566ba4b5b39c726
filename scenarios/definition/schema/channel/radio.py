"""What a scenario file may say of a link's radio: a table over distance, or the loss on the way."""

from typing import Annotated, Literal

from pydantic import Field

from scenarios.definition.schema.table import NotNegative, Ratio, Table

Decibels = Annotated[float, Field(ge=-300, le=300)]
Deviation = Annotated[float, Field(ge=0, le=60)]
Metres = Annotated[tuple[NotNegative, ...], Field(strict=False, min_length=1)]
Ratios = Annotated[tuple[Ratio, ...], Field(strict=False, min_length=1)]
Curve = Annotated[tuple[Decibels, ...], Field(strict=False, min_length=2)]
Errors = Annotated[
    tuple[Annotated[float, Field(gt=0, lt=1)], ...], Field(strict=False, min_length=2)
]


class TableRadio(Table):
    """The share of messages that is delivered over the true distance.

    `delivery_ratio` has a number for each of `distance_m`: linear between two, constant before the
    first, 0 beyond the last. `burst` says whether each message is lost on its own, or all together
    that are sent with one reservation: for as many messages as the limits say, all numbers equally
    likely, and kept on with `keep_ratio` (3GPP TS 36.321: 5 to 15 at 10 Hz, 0 to 0.8).
    """

    kind: Literal["table"]
    distance_m: Metres
    delivery_ratio: Ratios
    burst: Literal["independent", "reservation"] = "independent"
    keep_ratio: float = Field(default=0.0, ge=0, le=0.99)
    reselection_messages_min: int = Field(default=5, ge=1, le=1000)
    reselection_messages_max: int = Field(default=15, ge=1, le=1000)


class ErrorTable(Table):
    """Packet errors over the ratio of signal to noise, in sight and behind vehicles.

    The default is IEEE 802.11p with 350 bytes on highways. On normal probability paper the curves
    are straight between the points, and on beyond them.
    """

    snr_db: Curve = (1.0, 3.1, 5.2)
    error_ratio: Errors = (0.5, 0.1, 0.01)
    obstructed_snr_db: Curve = (4.7, 6.8, 8.6)
    obstructed_error_ratio: Errors = (0.5, 0.1, 0.01)


class ShadowingTable(Table):
    """Slow wavering of the strength: standard deviations, and the way over which it decorrelates.

    ETSI TR 103 257: 3 dB in sight, 4 dB not, 25 m on highways; the autocorrelation is
    e^(−metres driven by the receiver / `decorrelation_m`).
    """

    deviation_db: Deviation = 3.0
    obstructed_deviation_db: Deviation = 4.0
    decorrelation_m: float = Field(default=25.0, ge=1, le=10_000)


Radius = Annotated[float, Field(ge=0, le=10)]


class PerVehicleTable(Table):
    """Each vehicle in between whose circle cuts the line of sight costs the same (TR 103 257)."""

    kind: Literal["etsi"]
    loss_db: float = Field(default=6.9, ge=0.1, le=100)
    radius_m: Radius = 1.5


class OnceForAllTable(Table):
    """Vehicles in between cost max(0, N(mean, deviation)) once, however many (3GPP TR 37.885).

    The mean grows by max(0, 15 log₁₀ d − 41) dB over d metres. 9 and 4.5 dB are for lorries, higher
    than both antennas; 5 and 4 dB for cars.
    """

    kind: Literal["3gpp"]
    mean_db: Decibels = 9.0
    deviation_db: Deviation = 4.5
    radius_m: Radius = 1.5


ObstructionTable = Annotated[PerVehicleTable | OnceForAllTable, Field(discriminator="kind")]


class PathLossRadio(Table):
    """The ratio of signal to noise over the true distance, and the packet errors that follow.

    `propagation` is that of 3GPP TR 37.885 for highways, 32.4 + 20 log₁₀ d + 20 log₁₀ f (f in
    GHz), or "log_distance": `reference_loss_db` at 1 m and 10 · `exponent` dB for each tenfold
    distance. `power_dbm` is with the gains of both antennas. Without `shadowing` or `obstruction`
    there is none. There is no interference.
    """

    kind: Literal["path_loss"]
    power_dbm: Decibels = 23.0
    frequency_hz: float = Field(default=5.9e9, ge=1e8, le=1e12)
    bandwidth_hz: float = Field(default=10e6, ge=1e3, le=1e10)
    noise_figure_db: float = Field(default=9.0, ge=0, le=60)
    propagation: Literal["3gpp_highway", "log_distance"] = "3gpp_highway"
    reference_loss_db: float = Field(default=47.8, ge=0, le=200)
    exponent: float = Field(default=2.0, ge=0.5, le=10)
    errors: ErrorTable = ErrorTable()
    shadowing: ShadowingTable | None = None
    obstruction: ObstructionTable | None = None


RadioTable = Annotated[TableRadio | PathLossRadio, Field(discriminator="kind")]
