"""Faults of files: encodings, bytes, rows and ends, and random damage."""

from collections.abc import Callable
from random import Random

from tests.made.spoiled.synthetic_drives import Recording

FileFault = Callable[[bytes, Random], bytes]

GARBAGE = {
    "csv": (
        "abc,def,ghi", "nan,nan,nan,nan", "7", "#", "inf,inf,inf,inf", '"open quote,1,2',
        "1" * 400, ",,,", "1e999,1e999,1e999,5", "\x01\x02\x03",
    ),
    "gpx": (
        '<trkpt lat="abc" lon="11.5"></trkpt>', '<trkpt lat="NaN" lon="NaN"></trkpt>',
        '<trkpt lon="11.5"></trkpt>', '<trkpt lat="" lon=""><time/></trkpt>',
        '<trkpt lat="91" lon="11.5"></trkpt>', '<trkpt lat="48.1" lon="1e9"></trkpt>',
    ),
    "nmea": (
        "$GNGGA,120000.00,48", "garbage", "$", "$GPTXT,01,01,02,hello*00",
        "$GNGGA,120000.00,4806.0000000,N,01130.0000000,E,4,12,0.8,500.0,M,40.0,M,,*00",
        "$GNRMC,,V,,,,,,,,,,N*4D", "\x01\x02\x03$G",
    ),
}  # fmt: skip
"""Records that hold no position."""


def with_garbage(recording: Recording, form: str, random: Random) -> Recording:
    rows = GARBAGE[form.rsplit(maxsplit=1)[-1]]
    for k in random.sample(range(len(recording.fixes)), random.randint(1, 4)):
        recording = recording.edited([k], lost=True, row=random.choice(rows))
    return recording


# --- Bytes that change no record


def byte_order_mark(data: bytes, _: Random) -> bytes:
    return b"\xef\xbb\xbf" + data


def utf_16(data: bytes, random: Random) -> bytes:
    encoding = random.choice(("utf-16", "utf-16-le", "utf-16-be"))
    return data.decode("utf-8", errors="replace").encode(encoding)


def other_line_ends(data: bytes, random: Random) -> bytes:
    return data.replace(b"\r\n", b"\n").replace(b"\n", random.choice((b"\r\n", b"\r", b"\n\n")))


def zero_bytes_first(data: bytes, random: Random) -> bytes:
    return b"\0" * random.randint(1, 9) + random.choice((b"", b"\r\n")) + data


def zero_bytes_last(data: bytes, random: Random) -> bytes:
    return data + b"\0" * random.choice((1, 100, 4096))


HARMLESS: dict[str, tuple[FileFault, tuple[str, ...]]] = {
    "byte order mark": (byte_order_mark, ("csv", "gpx", "nmea", "line")),
    "other line ends": (other_line_ends, ("csv", "gpx", "nmea")),
    "zero bytes first": (zero_bytes_first, ("nmea", "csv")),
    "zero bytes last": (zero_bytes_last, ("nmea", "csv", "gpx")),
    "utf-16": (utf_16, ("csv", "gpx", "nmea")),
}
"""Faults with the formats they apply to, in the order in which they are applied."""


def truncated(data: bytes, random: Random) -> bytes:
    return data[: len(data) - random.randint(1, len(data) // 20)]


# --- Random damage


def _flipped(data: bytearray, random: Random) -> None:
    for _ in range(random.randint(1, 40)):
        data[random.randrange(len(data))] = random.randrange(256)


def _cut(data: bytearray, random: Random) -> None:
    k = random.randrange(len(data))
    del data[k : k + random.randint(1, max(1, len(data) // 3))]


def _inserted(data: bytearray, random: Random) -> None:
    k = random.randrange(len(data))
    data[k:k] = random.choice(
        (
            random.randbytes(300), b"\0" * 5000, b"\xff\xfe", b"\n" * 3000, b"," * 3000, b'"',
            b"9" * 5000, b"1e308,", b"-1e308,", b"nan,", b"<", b"&amp;" * 500, b"<a>" * 3000,
            b"]]>", b"<!--", b"$GPRMC,", b"{" * 3000, b"[" * 3000, "٣٤٥".encode(), b"#", b"\r",
            b"1970-01-01T00:00:00Z", b"9999-12-31T23:59:59Z", b"1e18,", b"\xe2\x80\xa8",
        )
    )  # fmt: skip


def _repeated(data: bytearray, random: Random) -> None:
    k = random.randrange(len(data))
    piece = data[k : k + random.randint(1, 2000)]
    data[k:k] = piece * random.randint(1, 20)


def _shuffled(data: bytearray, random: Random) -> None:
    lines = bytes(data).split(b"\n")
    random.shuffle(lines)
    data[:] = b"\n".join(lines)


def _digits(data: bytearray, random: Random) -> None:
    places = [k for k, byte in enumerate(data) if byte in b"0123456789.-"]
    for k in random.choices(places, k=random.randint(1, 30)) if places else ():
        data[k] = random.choice(b"0123456789.-eE+")


def _swapped_cells(data: bytearray, random: Random) -> None:
    old, new = random.sample((b",", b";", b"\t", b" ", b".", b":", b"<", b'"', b"$"), 2)
    data[:] = bytes(data).replace(old, new)


DAMAGES = (_flipped, _cut, _inserted, _repeated, _shuffled, _digits, _swapped_cells)


def damaged(data: bytes, random: Random) -> bytes:
    result = bytearray(data)
    for damage in random.choices(DAMAGES, k=random.randint(1, 4)):
        if result:
            damage(result, random)
    return bytes(result)
