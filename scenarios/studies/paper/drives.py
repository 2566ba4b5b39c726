"""The drives of one run as arrays: the paper's errors and the true ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME
from scenarios.results.log_summary import tables_of
from scenarios.results.tables import RunTables
from scenarios.results.true_motion import path_feet
from scenarios.runs.observer import Observer
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_tables, run_virtual
from transport.columns import Floats
from transport.log.errors import LogError
from vehicles.messages import Message, RunStart, Tracking, TruePose
from vehicles.schedule import SECOND

TRIAL_KINDS: frozenset[type[Message]] = frozenset((RunStart, TruePose, Tracking))
"""Messages of which drives are made."""


@dataclass(frozen=True)
class Drive:
    """The drive of one vehicle, an entry per control instant (s from the start, m, m/s, rad).

    `lateral_error` and `heading_error` are the paper's: relative to the vehicle's own trajectory.
    `station` and `cross_track` are the true position along and across the lead's driven path and
    the straight before its start; empty for the lead.
    """

    name: str
    at: Floats
    east: Floats
    north: Floats
    speed: Floats
    lateral_error: Floats
    heading_error: Floats
    station: Floats
    cross_track: Floats

    @property
    def tracking_max(self) -> float:
        """Largest |e_lat| (m) relative to the own trajectory."""
        return _largest(self.lateral_error)

    @property
    def cross_track_max(self) -> float:
        """Largest true distance (m) from the lead's driven path."""
        return _largest(self.cross_track)


@dataclass(frozen=True)
class Trial:
    """The drives of one run, the lead first."""

    drives: tuple[Drive, ...]

    @property
    def lead(self) -> Drive:
        return self.drives[0]

    @property
    def followers(self) -> tuple[Drive, ...]:
        return self.drives[1:]

    @cached_property
    def tracking(self) -> tuple[float, ...]:
        """Largest |e_lat| (m) of each follower relative to its own trajectory."""
        return tuple(drive.tracking_max for drive in self.followers)

    @cached_property
    def cross_track(self) -> tuple[float, ...]:
        """Largest true cross-track error (m) of each follower."""
        return tuple(drive.cross_track_max for drive in self.followers)


def _largest(values: Floats) -> float:
    return float(np.abs(values).max(initial=0.0))


def trial_of(run: RunTables) -> Trial:
    """Drives of a run."""
    return Trial(tuple(_drive(run, name) for name in run.names if len(run.table(name, "truth"))))


def _drive(run: RunTables, name: str) -> Drive:
    truth, tracking = run.table(name, "truth"), run.table(name, "tracking")
    station = lateral = np.zeros(0)
    if name != run.lead:
        feet = path_feet(run, name)
        known = ~np.isnan(feet.station)
        station, lateral = feet.station[known], feet.lateral[known]
    return Drive(
        name=name,
        at=(truth.at_ns - run.scenario.start_at_ns) / SECOND,
        east=truth["east_m"],
        north=truth["north_m"],
        speed=truth["speed_mps"],
        lateral_error=tracking["lateral_error_m"],
        heading_error=tracking["heading_error_rad"],
        station=station,
        cross_track=lateral,
    )


def drive_trial(scenario: Scenario) -> Trial:
    """Run `scenario` in virtual time and keep its drives; raises VehicleFaultError."""
    run, outcome = run_tables(scenario, kinds=TRIAL_KINDS)
    outcome.raise_fault()
    return trial_of(run)


def record_trial(
    scenario: Scenario,
    folder: Path,
    observers: Sequence[Observer] = (),
) -> Trial:
    """Run `scenario` as `run_virtual` does and keep its drives; raises LogError if it fails."""
    summary = run_virtual(scenario, folder, Stop(), observers=observers)
    if summary.reason:
        raise LogError(summary.reason)
    return trial_of(tables_of(folder / LOG_NAME))
