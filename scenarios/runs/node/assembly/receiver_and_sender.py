"""Builds the GNSS receiver and the sender of a node."""

from collections.abc import Iterator, Sequence
from functools import partial
from hashlib import blake2b

import numpy as np
from numpy.random import Generator

from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.plug_ins.emission import begin_error, begin_rule
from scenarios.definition.vehicle_setup import VehicleSetup
from vehicles.car.gnss import GnssReceiver
from vehicles.car.positioning.error_term import ReceiverContext, Streams
from vehicles.car.positioning.gnss_errors import ReceiverErrors
from vehicles.car.sending.path_history import PathHistory
from vehicles.car.sending.rule import SendingContext
from vehicles.car.sending.sender import Sender
from vehicles.geometry.geodesy import LocalPlane
from vehicles.schedule import instants

RECEIVER_STREAM = 2
"""Key of these random streams; that of an inertial sensor is 1."""
SHARED_STREAM = 2**32 - 1
"""Place in the convoy for random streams that all vehicles share."""


def make_receiver(scenario: Scenario, setup: VehicleSetup, start_at: int) -> GnssReceiver:
    """Make the receiver of a vehicle in a run that starts at `start_at` (ns).

    White noise and each other error have random streams of their own, so that none affects another.
    """
    gnss = setup.gnss
    random = np.random.Generator(np.random.PCG64([scenario.seed, setup.place]))
    start = ReceiverContext(
        start_at,
        distance_behind_lead=sum(scenario.route.spacings[: setup.place + 1]),
        own_streams=_streams(scenario.seed, setup.place),
        shared_streams=_streams(scenario.seed, SHARED_STREAM),
    )
    return GnssReceiver(
        gnss.noise, gnss.rate, start_at, random, ReceiverErrors(gnss, start, begin_error)
    )


def make_sender(scenario: Scenario, setup: VehicleSetup, start_at: int) -> Sender:
    rule = setup.sending
    control = None if rule.dcc is None else rule.dcc.begin(start_at)
    path = PathHistory(LocalPlane(scenario.origin), rule.path_history, rule.path_history_points)
    return Sender(begin_rule(rule, _sending_start(scenario, setup, start_at)), control, path)


def extra_instants(
    scenario: Scenario, setup: VehicleSetup, start_at: int, end_at: int
) -> Sequence[Iterator[int]]:
    """Instants (ns) of sending and of late fixes, which need ticks of their own.

    Randomly drawn intervals have none: their messages wait for the next tick.
    """
    schedules: list[Iterator[int]] = []
    if setup.gnss.latency:
        schedules.append(instants(start_at + setup.gnss.latency, end_at, setup.gnss.rate))
    of_sending = setup.sending.instants(_sending_start(scenario, setup, start_at), end_at)
    return schedules if of_sending is None else [*schedules, of_sending]


def _sending_start(scenario: Scenario, setup: VehicleSetup, start_at: int) -> SendingContext:
    return SendingContext(start_at, _streams(scenario.seed, setup.place))


def _streams(seed: int, place: int) -> Streams:
    return partial(_stream, seed, place)  # no closure: a receiver can be pickled


def _stream(seed: int, place: int, purpose: str) -> Generator:
    word = int.from_bytes(blake2b(purpose.encode(), digest_size=4).digest(), "little")
    return np.random.Generator(np.random.PCG64([seed, place, RECEIVER_STREAM, word]))
