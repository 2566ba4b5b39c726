"""Sentences of NMEA 0183 as rows of numbers."""

import math
import re
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.formats.time_cells import as_number
from scenarios.definition.traces.recorded_drive import (
    NOT_A_POSITION,
    Floats,
    LeftOut,
    LeftOutRecords,
)

Integers = NDArray[np.int64]

KNOT: Final = 1852.0 / 3600.0
"""Knot (m/s)."""

NO_CHECKSUM: Final = "wrong or missing checksum"
NOT_A_SENTENCE: Final = "not a sentence"

BLOCK: Final = 4_000_000
"""Number of characters that are read at a time, to bound the memory."""

PADDING: Final = b"\n" * 8

FIELDS_MAX: Final = 16


class SentenceFields(NamedTuple):
    """Numbers of the fields of a sentence, 0 for those that it does not have.

    Latitude, its hemisphere, longitude and its hemisphere follow each other.
    """

    time: int = 0
    latitude: int = 0
    status: int = 0
    altitude: int = 0
    geoid: int = 0
    knots: int = 0
    date: int = 0


LAYOUTS: Final = {
    "GGA": SentenceFields(time=1, latitude=2, status=6, altitude=9, geoid=11),
    "GNS": SentenceFields(time=1, latitude=2, status=6, altitude=9, geoid=10),
    "RMC": SentenceFields(time=1, status=2, latitude=3, knots=7, date=9),
    "GLL": SentenceFields(latitude=1, time=5, status=6),
    "ZDA": SentenceFields(time=1, date=2),
    "VTG": SentenceFields(knots=5),
}
"""Sentences that are read; the position of the first kind counts. ZDA has the date in 3 fields."""

KINDS: Final = tuple(LAYOUTS)

VALUES: Final = ("day_s", "latitude", "longitude", "altitude", "speed", "date")

ROW: Final = np.dtype(
    [
        *((name, np.int64) for name in ("kind", "talker", "number")),
        *((name, np.float64) for name in VALUES),
        ("unfit", np.bool_),
    ]
)
"""A sentence: place in KINDS, letters of the talker, line, and values that are NaN where unknown.

`day_s` are seconds since midnight, `date` days since 1970; `unfit` is quality 0 or status V.
"""

CHECKED: Final = re.compile(r"\$[A-Z]{2}(?:GGA|GNS|RMC|GLL),[^\r\n$*]*\*[0-9A-Fa-f]{2}")

UNFIT: Final = np.isin(np.arange(256), list(b"0VvN"))
"""Letters of a position without a valid fix."""

DIGITS_MAX: Final = 15
TEN_TO: Final = 10.0 ** np.arange(DIGITS_MAX + 3)

HEX: Final = np.full(256, 255, dtype=np.uint8)
for _digit in b"0123456789abcdefABCDEF":
    HEX[_digit] = int(chr(_digit), 16)


def sentences_in(text: str, left_out: LeftOutRecords) -> tuple[NDArray[np.void], bool]:
    """Return the sentences as ROWs in the order of the file, and whether they have checksums.

    Sentences with a wrong checksum and other lines are left out. Checksums may be missing if all
    sentences lack them.
    """
    checked = CHECKED.search(text) is not None
    rows, line = [np.empty(0, dtype=ROW)], 1
    for data in _blocks(text):
        block = _Block(data, line)
        rows.append(block.rows(left_out, checked))
        line += block.lines
    return np.concatenate(rows), checked


def _blocks(text: str) -> Iterator[bytes]:
    """Yield whole lines of about BLOCK characters, with PADDING."""
    begin = 0
    while begin < len(text):
        end = text.find("\n", begin + BLOCK) + 1 or len(text)
        yield text[begin:end].encode("ascii", errors="replace") + PADDING
        begin = end


class _Block:
    """Sentences in some lines of a file: `begins` at $, and `ends` at * or the end of the line."""

    def __init__(self, data: bytes, first_line: int) -> None:
        codes = np.frombuffer(data, dtype=np.uint8)
        breaks = np.flatnonzero((codes == 10) | (codes == 13))
        after_return = (codes[breaks] == 10) & (codes[breaks - 1] == 13)
        self.line_ends = breaks[~after_return]
        self.lines = int(np.searchsorted(self.line_ends, len(data) - len(PADDING)))
        self.first_line = first_line
        self.data, self.codes = data, codes
        self.begins = np.flatnonzero(codes == ord("$"))
        self.numbers = np.searchsorted(self.line_ends, self.begins) + first_line
        stops = np.minimum(
            breaks[np.searchsorted(breaks, self.begins)], np.append(self.begins, len(data))[1:]
        )
        stars = np.append(np.flatnonzero(codes == ord("*")), len(data))
        star = stars[np.searchsorted(stars, self.begins)]
        self.has_star = star < stops
        self.ends = np.where(self.has_star, star, stops)
        self.commas = self._places(",", FIELDS_MAX)
        self.dots = self._places(".", 1)

    def _places(self, sign: str, more: int) -> Integers:
        places = np.flatnonzero(self.codes == ord(sign))
        return np.append(places, np.full(more, len(self.data) - 1))

    def rows(self, left_out: LeftOutRecords, checked: bool) -> NDArray[np.void]:
        kinds, sound = self._kinds(), self._sound()
        if not checked:
            sound = ~self.has_star
        for number in self.numbers[~sound].tolist():
            left_out.add(LeftOut(number, NO_CHECKSUM, NO_CHECKSUM))
        self._list_other_lines(left_out)
        rows = np.zeros(len(kinds), dtype=ROW)
        for name in VALUES:
            rows[name] = math.nan
        rows["kind"], rows["number"] = kinds, self.numbers
        first, second = (self.codes[self.begins + k].astype(np.int64) for k in (1, 2))
        rows["talker"] = 256 * first + second
        for kind, layout in enumerate(LAYOUTS.values()):
            places = np.flatnonzero(sound & (kinds == kind))
            rows[places] = self._read(places, layout, rows[places], left_out)
        return rows[sound & (kinds >= 0)]

    def _kinds(self) -> Integers:
        """Return the kind of each sentence, -1 for those that are not read."""
        at = self.begins
        kinds = np.full(at.size, -1)
        letters = [self.codes[at + k] for k in (3, 4, 5)]
        addressed = (self.codes[at + 6] == ord(",")) & (self.codes[at + 1] != ord("P"))
        for kind, name in enumerate(KINDS):
            same = [column == ord(letter) for column, letter in zip(letters, name, strict=True)]
            kinds[addressed & same[0] & same[1] & same[2]] = kind
        return kinds

    def _sound(self) -> NDArray[np.bool_]:
        """Whether the checksum of each sentence is right."""
        if not self.begins.size:
            return np.zeros(0, dtype=bool)
        spans = np.stack((self.begins + 1, self.ends), axis=1).ravel()
        sums = np.bitwise_xor.reduceat(self.codes, spans)[::2]
        high, low = (HEX[self.codes[self.ends + k]].astype(np.int64) for k in (1, 2))
        right: NDArray[np.bool_] = self.has_star & (16 * high + low == sums)
        return right

    def _list_other_lines(self, left_out: LeftOutRecords) -> None:
        begins = np.append(0, self.line_ends[:-1] + 1)
        sentences = np.searchsorted(self.begins, np.append(begins, len(self.data)))
        bare = (np.diff(sentences) == 0) & (self.line_ends > begins)
        for line in np.flatnonzero(bare).tolist():
            content = self.data[begins[line] : self.line_ends[line]].strip()
            if content and not content.startswith(b"!"):  # AIS
                left_out.add(LeftOut(line + self.first_line, NOT_A_SENTENCE, NOT_A_SENTENCE))

    def _read(
        self,
        places: Integers,
        layout: SentenceFields,
        rows: NDArray[np.void],
        left_out: LeftOutRecords,
    ) -> NDArray[np.void]:
        """Fill the rows of sentences of one kind."""
        first = np.searchsorted(self.commas, self.begins[places])
        ends = self.ends[places]

        def field(k: int) -> tuple[Integers, Integers]:
            begin = np.minimum(self.commas[first + k - 1] + 1, ends)
            return begin, np.minimum(self.commas[first + k], ends)

        def values(k: int) -> Floats:
            return self._floats(*field(k))

        if layout.time:
            rows["day_s"] = _day_seconds(values(layout.time))
        if layout.altitude:
            rows["altitude"] = values(layout.altitude) + np.nan_to_num(values(layout.geoid))
        if layout.knots:
            rows["speed"] = values(layout.knots) * KNOT
        if layout.date and layout.latitude:
            rows["date"] = _days(*_parts(values(layout.date)))
        elif layout.date:
            rows["date"] = _days(*(values(layout.date + k) for k in range(3)))
        if layout.status:
            rows["unfit"] = self._is_unfit(*field(layout.status))
        if layout.latitude:
            self._locate(rows, [field(layout.latitude + k) for k in range(4)], left_out)
        return rows

    def _is_unfit(self, begins: Integers, ends: Integers) -> NDArray[np.bool_]:
        """Whether cells are 0 or V, or N for the first two satellite systems of GNS."""
        first, second = (UNFIT[self.codes[begins + k]] for k in (0, 1))
        unfit: NDArray[np.bool_] = (ends > begins) & first & (second | (ends == begins + 1))
        return unfit

    def _locate(
        self,
        rows: NDArray[np.void],
        fields: Sequence[tuple[Integers, Integers]],
        left_out: LeftOutRecords,
    ) -> None:
        """Fill latitude and longitude by their fields and those of the hemispheres."""
        (a, b), (north, _), (c, d), (east, _) = fields
        latitude, longitude = self._angles(a, b, north, "NS"), self._angles(c, d, east, "EW")
        unread = ~np.isfinite(latitude + longitude)
        for k in np.flatnonzero(unread & (a < b) & (c < d)).tolist():
            cells = self.data[a[k] : d[k] + 2].decode()
            left_out.add(
                LeftOut(int(rows["number"][k]), NOT_A_POSITION, f"position is {cells!r:.40}")
            )
        latitude[unread] = math.nan
        rows["latitude"], rows["longitude"] = latitude, longitude

    def _floats(self, begins: Integers, ends: Integers) -> Floats:
        """Return the numbers of cells, NaN where there is none.

        A number of up to 15 digits is an integer over a power of ten, both of which are exact.
        """
        length = ends - begins
        places = np.arange(min(DIGITS_MAX + 2, int(length.max(initial=0))))[:, None]
        codes = self.codes[np.minimum(begins + places, len(self.data) - 1)]
        inside = places < length
        digit = codes - ord("0")  # wraps around for other signs
        is_digit, is_dot = inside & (digit < 10), inside & (codes == ord("."))
        is_minus = inside & (codes == ord("-")) & (places == 0)
        behind = np.logical_or.accumulate(is_dot) & is_digit
        values = np.zeros(begins.size)
        for use, value in zip(is_digit, digit, strict=True):
            values = np.where(use, 10.0 * values + value, values)
        values /= TEN_TO[behind.sum(axis=0)]
        values = np.where(is_minus.any(axis=0), -values, values)
        count, dots = is_digit.sum(axis=0), is_dot.sum(axis=0)
        plain = (count > 0) & (count <= DIGITS_MAX) & (dots <= 1)
        plain &= count + dots + is_minus.sum(axis=0) == length
        values[~plain] = math.nan
        for k in np.flatnonzero(~plain & (length > 0)).tolist():
            values[k] = as_number(self.data[begins[k] : ends[k]].decode())
        return values

    def _angles(self, begins: Integers, ends: Integers, hemisphere: Integers, signs: str) -> Floats:
        """Return the degrees of cells dddmm.mmm, NaN without a hemisphere."""
        dots = np.minimum(self.dots[np.searchsorted(self.dots, begins)], ends)
        minutes_at = np.maximum(dots - 2, begins)
        whole = self._floats(begins, minutes_at)
        angles = whole + self._floats(minutes_at, ends) / 60.0
        letters = self.codes[hemisphere] & 0xDF  # in upper case
        positive, negative = (letters == ord(sign) for sign in signs)
        known = (whole >= 0) & (positive | negative)
        return np.where(known, np.where(negative, -angles, angles), math.nan)


def _parts(values: Floats) -> tuple[Floats, Floats, Floats]:
    """Split numbers such as ddmmyy into their three parts."""
    first, rest = np.divmod(values, 10_000.0)
    return first, *np.divmod(rest, 100.0)


def _day_seconds(clocks: Floats) -> Floats:
    """Convert times hhmmss.sss to seconds since midnight."""
    micros = np.rint(clocks * 1e6)
    whole, fraction = np.divmod(micros, 1e6)
    hour, minute, second = _parts(whole)
    seconds = hour * 3600.0 + minute * 60.0 + second + fraction * 1e-6
    return np.where((hour < 24) & (minute < 60) & (second <= 60), seconds, math.nan)


def _days(day: Floats, month: Floats, year: Floats) -> Floats:
    """Return the days since 1970 of dates; years of two digits are 1980 to 2079."""
    year = np.where(year < 80, year + 2000, np.where(year < 100, year + 1900, year))
    usable = (day >= 1) & (month >= 1) & (month <= 12) & (year < 2200)
    month_number = np.where(usable, (year - 1970) * 12 + month - 1, 0).astype(np.int64)
    begin, end = (
        (month_number + k).astype("datetime64[M]").astype("datetime64[D]").astype(float)
        for k in (0, 1)
    )
    return np.where(usable & (begin + day <= end), begin + day - 1, math.nan)
