"""NMEA 0183: what GNSS receivers print, one sentence a line, each with its checksum."""

import math
from collections.abc import Iterator
from dataclasses import replace
from datetime import time
from typing import Any

from scenarios.definition.traces.formats import Recording, Sample, TraceError

KNOT = 1852.0 / 3600.0
"""Metres per second in a knot, the unit of speed in NMEA 0183."""

DAY = 86_400.0
"""Seconds in a day, after which the times of NMEA 0183 start again."""


def read_nmea(text: str) -> Recording:
    """Read the GGA and RMC sentences of a receiver's output; both of one instant become one sample.

    A sentence must have its checksum and a valid fix; other kinds of sentence are ignored. Speed
    comes from RMC. Times of day go on counting over midnight. Raises TraceError if none is valid.
    """
    recording = Recording(geodetic=True)
    samples, day, last = recording.samples, 0.0, -math.inf
    for place, sentence in _sentences(text, recording.skipped):
        sample = _sample(place, sentence)
        if sample is None:
            recording.skipped.append(f"{place}: no fix")
            continue
        if sample.time is not None:
            day += DAY if sample.time + day < last - DAY / 2 else 0.0
            sample = replace(sample, time=sample.time + day)
        if samples and sample.time is not None and sample.time == samples[-1].time:
            samples[-1] = _merged(samples[-1], sample)
        else:
            samples.append(sample)
        last = last if sample.time is None else sample.time
    if not samples:
        reason = f", {recording.skipped[0]}" if recording.skipped else ""
        raise TraceError(f"no valid GGA or RMC sentence{reason}")
    return recording


def _sentences(text: str, skipped: list[str]) -> Iterator[tuple[str, Any]]:
    """Give the GGA and RMC sentences with where they stand; bad ones go to `skipped`."""
    import pynmea2  # noqa: PLC0415 - not in a vehicle's process

    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        try:
            sentence = pynmea2.parse(line.strip(), check=True)
        except pynmea2.SentenceTypeError:
            continue
        except pynmea2.ChecksumError:
            skipped.append(f"line {number}: wrong or missing checksum")
            continue
        except (pynmea2.ParseError, ValueError):
            skipped.append(f"line {number}: not a sentence")
            continue
        if isinstance(sentence, pynmea2.GGA | pynmea2.RMC):
            yield f"line {number}", sentence


def _sample(place: str, sentence: Any) -> Sample | None:
    """Return what a sentence says of place, time and speed; None without a valid fix."""
    try:
        if not (sentence.lat and sentence.lon and sentence.is_valid):
            return None
        knots = getattr(sentence, "spd_over_grnd", None)
        return Sample(
            place=place,
            position=(float(sentence.latitude), float(sentence.longitude)),
            altitude=_altitude(sentence),
            time=_time_of_day(sentence.timestamp),
            speed=None if knots is None else float(knots) * KNOT,
        )
    except (ValueError, TypeError):  # no number in a field, although the checksum is right
        return None


def _altitude(sentence: Any) -> float | None:
    """Return the height above the ellipsoid (m): that above sea level plus the geoid's."""
    if not getattr(sentence, "altitude", None):
        return None
    return float(sentence.altitude) + float(sentence.geo_sep or 0.0)


def _time_of_day(clock: object) -> float | None:
    if not isinstance(clock, time):
        return None
    return clock.hour * 3600.0 + clock.minute * 60.0 + clock.second + clock.microsecond * 1e-6


def _merged(one: Sample, other: Sample) -> Sample:
    """Return the first sample of an instant with what the second one adds."""
    return replace(
        one,
        altitude=other.altitude if one.altitude is None else one.altitude,
        speed=other.speed if one.speed is None else one.speed,
    )
