"""What a vehicle measures of its place, and when it sends it: receiver and sender of a node."""

from collections.abc import Iterator, Sequence
from functools import partial
from hashlib import blake2b
from itertools import takewhile

import numpy as np
from numpy.random import Generator

from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.sending import CamSending, DccTable, FixedSending
from scenarios.definition.sending import shares_of
from scenarios.definition.vehicle_setup import VehicleSetup
from vehicles.car.gnss import GnssReceiver
from vehicles.car.positioning.error_term import ReceiverStart, Streams
from vehicles.car.positioning.gnss_errors import ReceiverErrors
from vehicles.car.sending import (
    CooperativeAwareness,
    DrawnIntervals,
    EveryFix,
    FixedRate,
    Profile,
    ReactiveControl,
    Sender,
    SendingRule,
    profile_instants,
)
from vehicles.schedule import MILLISECOND, SECOND, Cadence, instants, nanoseconds

SIGNALS = 2
"""Tells the random streams made here from that of an inertial sensor, which is 1."""
EVERYBODY = 2**32 - 1
"""Stands for a vehicle's place in the streams that all have in common."""


def make_receiver(scenario: Scenario, setup: VehicleSetup, start_at: int) -> GnssReceiver:
    """Make the receiver of a vehicle in a run that starts at `start_at` (ns).

    A stream for its white noise, which does not depend on the number of vehicles, and one for each
    of its other errors, so that none changes another.
    """
    gnss, random = setup.gnss, white_noise(scenario.seed, setup.place)
    start = ReceiverStart(
        start_at,
        behind=sum(scenario.route.gaps[: setup.place + 1]),
        own=_streams(scenario.seed, setup.place),
        shared=_streams(scenario.seed, EVERYBODY),
    )
    return GnssReceiver(gnss.noise, gnss.rate, start_at, random, ReceiverErrors(gnss, start))


def white_noise(seed: int, place: int) -> Generator:
    """The stream of the white noise of the receiver of the vehicle at a place in the convoy."""
    return np.random.Generator(np.random.PCG64([seed, place]))


def make_sender(scenario: Scenario, setup: VehicleSetup, start_at: int) -> Sender:
    """Make what decides when a vehicle sends, in a run that starts at `start_at` (ns)."""
    dcc = setup.sending.dcc
    control = None if dcc is None else _control(dcc, start_at)
    return Sender(_rule(scenario, setup, start_at), control)


def instants_besides(
    scenario: Scenario, setup: VehicleSetup, start_at: int, end_at: int
) -> Sequence[Iterator[int]]:
    """Instants (ns) of sending, and of fixes that come late: a node has to be awake then.

    Intervals that are drawn have none: what is due then waits for the next tick.
    """
    found: list[Iterator[int]] = []
    if setup.gnss.latency:
        found.append(instants(start_at + setup.gnss.latency, end_at, setup.gnss.rate))
    table = setup.sending
    if table.kind == "profile":
        profile = [(point.at_s, point.rate_hz) for point in table.profile]
        each = (start_at + at for at in profile_instants(profile))
        found.append(takewhile(lambda at: at < end_at, each))
    elif table.kind in ("fixed", "cam"):
        cadence = _cadence(scenario, setup, table, start_at)
        found.append(instants(cadence.start_at, end_at, cadence.rate_hz))
    return found


def _streams(seed: int, place: int) -> Streams:
    return partial(_stream, seed, place)  # no closure: a receiver can be pickled


def _stream(seed: int, place: int, purpose: str) -> Generator:
    word = int.from_bytes(blake2b(purpose.encode(), digest_size=4).digest(), "little")
    return np.random.Generator(np.random.PCG64([seed, place, SIGNALS, word]))


def _rule(scenario: Scenario, setup: VehicleSetup, start_at: int) -> SendingRule:
    table = setup.sending
    match table.kind:
        case "every_fix":
            return EveryFix()
        case "fixed":
            return FixedRate(_cadence(scenario, setup, table, start_at))
        case "profile":
            return Profile([(point.at_s, point.rate_hz) for point in table.profile], start_at)
        case "cam":
            return CooperativeAwareness(_cadence(scenario, setup, table, start_at))
        case "intervals":
            random = _streams(scenario.seed, setup.place)("intervals")
            return DrawnIntervals(shares_of(table), start_at, random)


def _cadence(
    scenario: Scenario, setup: VehicleSetup, table: FixedSending | CamSending, start_at: int
) -> Cadence:
    """Schedule of sending, or of looking whether to send, with its phase."""
    rate_hz = table.rate_hz if table.kind == "fixed" else 1000.0 / table.check_period_ms
    phase = nanoseconds(table.phase_s)
    if table.drawn_phase:
        drawn = _streams(scenario.seed, setup.place)("phase").random()
        phase = int(drawn * SECOND / rate_hz)
    return Cadence(start_at + phase, rate_hz)


def _control(table: DccTable, start_at: int) -> ReactiveControl:
    busy = [(point.at_s, point.busy_ratio) for point in table.busy]
    return ReactiveControl(busy, start_at, round(table.period_ms * MILLISECOND))
