"""GNSS receivers of vehicles at places in a convoy."""

from collections.abc import Sequence
from hashlib import blake2b

import numpy as np
from numpy.random import Generator

from vehicles.car.gnss import GnssReceiver
from vehicles.car.gnss_error_terms import ReceiverContext, Streams
from vehicles.car.gnss_settings import GnssSettings

USUAL = GnssSettings()
SILENT = GnssSettings(position_noise=0.0, heading_noise=0.0, speed_noise=0.0, yaw_rate_noise=0.0)
SHARED_STREAM = 99


def streams(place: int) -> Streams:
    def stream(purpose: str) -> Generator:
        word = int.from_bytes(blake2b(purpose.encode(), digest_size=4).digest(), "little")
        return np.random.default_rng([5, place, 2, word])

    return stream


def started(start_at: int = 0, place: int = 1) -> ReceiverContext:
    return ReceiverContext(start_at, 0.0, streams(place), streams(SHARED_STREAM))


def receiver(
    settings: GnssSettings = USUAL, start_at: int = 0, seed: int | Sequence[int] = 1, place: int = 1
) -> GnssReceiver:
    """Receiver whose white noise has this seed."""
    return GnssReceiver(settings, started(start_at, place), np.random.default_rng(seed))
