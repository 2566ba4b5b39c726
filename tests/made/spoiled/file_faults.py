"""Random damage of files."""

from random import Random


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
