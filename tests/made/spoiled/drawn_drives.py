"""Random good drives, and random faults of their files, as strategies of hypothesis."""

import math
from dataclasses import dataclass, replace
from random import Random

from hypothesis import strategies as st

from tests.made.spoiled.drive_files import WRITERS
from tests.made.spoiled.file_faults import HARMLESS, truncated, with_garbage
from tests.made.spoiled.record_faults import KINDS, combined, spoiled
from tests.made.spoiled.synthetic_drives import Drive, Recording

MOST_POINTS = 1500
LEAST_POINTS = 25

PIECES = st.one_of(
    st.tuples(st.floats(40.0, 200.0), st.just(0.0)),
    st.builds(
        lambda radius, angle, side: (radius * angle, side / radius),
        st.floats(15.0, 200.0), st.floats(0.3, 1.8), st.sampled_from((-1, 1)),
    ),
    st.builds(
        lambda radius, side: (math.pi * radius, side / radius),
        st.floats(7.0, 12.0), st.sampled_from((-1, 1)),
    ),
    st.builds(
        lambda radius, side: (2.0 * math.pi * radius, side / radius),
        st.floats(15.0, 40.0), st.sampled_from((-1, 1)),
    ),
)  # fmt: skip
"""Straights, bends, U-turns and loops."""


@st.composite
def good_drives(draw: st.DrawFn) -> Drive:
    pieces = draw(st.lists(PIECES, min_size=1, max_size=4))
    road = tuple(piece for bend in pieces for piece in (bend, (draw(st.floats(20.0, 60.0)), 0.0)))
    rate = draw(st.sampled_from((1.0, 2.0, 5.0, 10.0, 20.0, 50.0)))
    noise = draw(st.floats(0.0, 0.05) if rate > 1.0 else st.floats(0.0, 2.0))
    length = sum(round(piece, 1) for piece, _ in road)
    stops = draw(st.lists(st.floats(0.2, 0.8), max_size=2, unique_by=lambda at: round(5.0 * at)))
    speed = draw(st.floats(4.0, 25.0))
    return Drive(
        road=((60.0, 0.0), *road),
        heading=draw(st.floats(-3.0, 3.0)),
        speed=max(min(speed, length * rate / LEAST_POINTS), length * rate / MOST_POINTS),
        stops=tuple((60.0 + at * length, draw(st.floats(3.0, 20.0))) for at in stops),
        rate_hz=rate,
        noise=noise,
        seed=draw(st.integers(0, 1000)),
        from_standstill=draw(st.booleans()),
    )


@dataclass(frozen=True, kw_only=True)
class SpoiledDrive:
    drive: Drive
    form: str
    faults: tuple[str, ...]
    bytes_faults: tuple[str, ...]
    garbage: bool
    truncated: bool
    seed: int

    @property
    def suffix(self) -> str:
        return WRITERS[self.form][0]

    def good(self) -> bytes:
        return WRITERS[self.form][1](self.drive.recorded())

    def file(self) -> tuple[Recording, bytes]:
        random = Random(self.seed)
        recording = spoiled(self.drive.recorded(), self.faults, self.seed)
        if self.garbage:
            recording = with_garbage(recording, self.form, random)
        data = WRITERS[self.form][1](recording)
        if self.truncated:
            data = truncated(data, random)
            last = {fix.truth for fix in recording.fixes[-len(recording.fixes) // 15 - 2 :]}
            recording = replace(recording, may_lack=recording.may_lack | last)
        for name in self.bytes_faults:
            data = HARMLESS[name][0](data, random)
        return recording, data


@st.composite
def spoiled_drives(draw: st.DrawFn) -> SpoiledDrive:
    form = draw(st.sampled_from(sorted(WRITERS)))
    kind = form.rsplit(maxsplit=1)[-1]
    names = draw(st.lists(st.sampled_from(sorted(KINDS)), max_size=6, unique=True))
    faults = combined(names, form)
    applicable = [name for name, (_, forms) in HARMLESS.items() if kind in forms]
    textual = kind in {"csv", "gpx", "nmea"}
    utf_16 = form == "utf-16 csv"
    chosen: list[str] = draw(st.lists(st.sampled_from(applicable or [""]), max_size=2, unique=True))
    if "utf-16" in chosen:
        chosen = ["utf-16"]  # other bytes would be none of its encoding
    return SpoiledDrive(
        drive=draw(good_drives()),
        form=form,
        faults=tuple(faults),
        bytes_faults=tuple(name for name in applicable if name in chosen and not utf_16),
        garbage=textual and draw(st.booleans()),
        truncated=textual and not utf_16 and draw(st.booleans()),
        seed=draw(st.integers(0, 10_000)),
    )
