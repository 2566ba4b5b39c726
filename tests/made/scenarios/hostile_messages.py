"""Random hostile messages under the keys of a convoy, derived from received ones.

`refusable` messages are invalid for any sender. `plausible` ones could come from a vehicle:
receivers cannot detect them, but must count them.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from random import Random
from typing import Any, get_args, get_origin

from transport.codec import MAX_BYTES, decode, encode
from transport.topics import RUN_SENDER, TOPIC_OF, TOPICS, key, valid_at
from vehicles.messages import FloatOrNan, LogText, Message
from vehicles.schedule import SECOND

Put = tuple[str, bytes]
NOT_NUMBERS = (float("nan"), float("inf"), float("-inf"))
NUMBERS = (0.0, -0.0, 5e-324, -1e308, 1e308, 1e9, -1.0, 360.0)
INSTANTS = (-(2**63), -1, 0, 1, 2**63 - 1)
SEQUENCES = (0, 1, 2**31, 2**32, 2**63, 2**64 - 1)
TEXTS = (
    "",
    "\x1b[2J\x1b]0;title\x07",
    "\u202eevil",
    "a\nb\r\nc",
    "[/red][bold",
    "é" * 7000,
    "\0" * 99,
)
FAR_NS = 10**17


class Stranger:
    """Draws hostile messages from those of a run that starts at `start_at` (ns)."""

    def __init__(self, chance: Random, vehicles: Sequence[str], start_at: int) -> None:
        self._chance = chance
        self._vehicles = vehicles
        self._start_at = start_at
        self._refusable: Sequence[Callable[[str, bytes], Put]] = (
            *(self._noise, self._cut, self._longer, self._giant, self._duplicate, self._elsewhere),
            *(self._of_another, self._not_a_number, self._other_kind, self._early, self._late),
            *(self._as_run_sender, self._invalid_word),
        )
        self._plausible: Sequence[Callable[[str, bytes], Put]] = (
            *(self._flipped, self._other_numbers, self._text, self._other_sequence),
        )

    def refusable(self, received: Sequence[Put]) -> Put:
        return self._chance.choice(self._refusable)(*self._chance.choice(received))

    def plausible(self, received: Sequence[Put]) -> Put:
        return self._chance.choice(self._plausible)(*self._chance.choice(received))

    # ---- Refusable

    def _noise(self, where: str, _data: bytes) -> Put:
        return where, self._chance.randbytes(self._chance.choice([0, 1, 20, 150, 600]))

    def _cut(self, where: str, data: bytes) -> Put:
        return where, data[: self._chance.randrange(len(data))]

    def _longer(self, where: str, data: bytes) -> Put:
        tail = (b"\xff", b"\xf8\x07\x01", data[:-1], b"\x1f" * 30)  # the second is another field
        return where, data + self._chance.choice(tail)

    def _giant(self, where: str, data: bytes) -> Put:
        size = self._chance.choice([MAX_BYTES + 1, 40_000, 300_000])
        return where, (data * (size // len(data) + 1))[: max(size, MAX_BYTES + 1)]

    def _duplicate(self, where: str, data: bytes) -> Put:
        return where, data

    def _elsewhere(self, where: str, data: bytes) -> Put:
        vehicle, topic = where.split("/")[1:]
        return self._chance.choice(
            [
                *(f"convoy/ghost/{topic}", f"{where}/deeper", f"convoy/{vehicle}/nothing"),
                *("convoy", "convoy/", f"convoy/{vehicle}", f"convoy/{vehicle.upper()}/{topic}"),
            ]
        ), data

    def _of_another(self, where: str, data: bytes) -> Put:
        message = read(where, data)
        others = [name for name in self._vehicles if name != message.vehicle]
        names = [*others, "ghost", RUN_SENDER, "", f"{message.vehicle}\0", "\x1b[31m", "v" * 300]
        return where, encode(replace(message, vehicle=self._chance.choice(names)))

    def _not_a_number(self, where: str, data: bytes) -> Put:
        message = read(where, data)
        invalid = [
            replace(message, **{field.name: value})  # type: ignore[arg-type]
            for field in fields(message)
            for value in NOT_NUMBERS
            if field.type is float or (field.type == FloatOrNan and value == value)  # noqa: PLR0124
        ]
        invalid += [
            replace(message, **{field.name: (*column[1:], float("nan"))})  # type: ignore[arg-type]
            for field in fields(message)
            if field.type == tuple[float, ...] and (column := getattr(message, field.name))
        ]
        return (where, encode(self._chance.choice(invalid))) if invalid else (where, b"")

    def _other_kind(self, where: str, data: bytes) -> Put:
        vehicle, own = where.split("/")[1:]
        others = [name for name in TOPICS if name not in {own, "start", "end"}]
        return key(vehicle, TOPICS[self._chance.choice(others)]), data

    def _early(self, where: str, data: bytes) -> Put:
        before = self._chance.choice([2 * SECOND, 3600 * SECOND, FAR_NS])
        return self._at(where, data, self._start_at - before)

    def _late(self, where: str, data: bytes) -> Put:
        after = self._chance.choice([3600 * SECOND, FAR_NS])
        return self._at(where, data, self._start_at + after)

    def _at(self, where: str, data: bytes, instant: int) -> Put:
        message = read(where, data)
        at = TOPIC_OF[type(message)].instant
        return where, encode(replace(message, seq=message.seq + 10**6, **{at: instant}))  # type: ignore[arg-type]

    def _as_run_sender(self, _where: str, data: bytes) -> Put:
        topic = TOPICS[self._chance.choice(list(TOPICS))]
        return key(RUN_SENDER, topic), data

    def _invalid_word(self, where: str, data: bytes) -> Put:
        message = read(where, data)
        words: list[Any] = [
            name
            for name in ("mode", "outcome", "level")
            if name in {f.name for f in fields(message)}
        ]
        wrong = ["", "COMPOSITE", "\x1b[31m", "x" * 5000]
        changed = {name: self._chance.choice(wrong) for name in words} or {"vehicle": "nobody"}
        return where, encode(replace(message, **changed))  # type: ignore[arg-type]

    # ---- Plausible

    def _flipped(self, where: str, data: bytes) -> Put:
        content = bytearray(data)
        for _ in range(self._chance.choice([1, 1, 2, 8])):
            content[self._chance.randrange(len(content))] ^= 1 << self._chance.randrange(8)
        return where, bytes(content)

    def _other_numbers(self, where: str, data: bytes) -> Put:
        message = read(where, data)
        changed: dict[str, Any] = {"seq": message.seq + self._chance.randrange(1, 50)}
        for field in fields(message):
            if self._chance.random() < 0.5:
                continue
            if field.type is float or field.type == FloatOrNan:
                changed[field.name] = self._chance.choice(NUMBERS)
            elif field.type is int and field.name.endswith("_ns"):
                near = valid_at(message) + self._chance.randrange(-SECOND, SECOND)
                changed[field.name] = self._chance.choice([*INSTANTS, near, near, near])
            elif field.type is int and field.name != "seq":
                changed[field.name] = self._chance.choice([0, 1, 2**31 - 1])
            elif get_origin(field.type) is tuple and get_args(field.type)[0] is float:
                changed[field.name] = self._chance.choice([(), (1e308,) * 5, (0.0,)])
        return where, encoded(message, changed)

    def _text(self, where: str, data: bytes) -> Put:
        vehicle = where.split("/")[1]
        text = LogText(
            vehicle=vehicle,
            seq=self._chance.randrange(10**6),
            logged_at_ns=valid_at(read(where, data)),
            level=self._chance.choice(["debug", "info", "warning", "error"]),
            text=self._chance.choice(TEXTS),
        )
        return key(vehicle, TOPICS["log"]), encode(text)

    def _other_sequence(self, where: str, data: bytes) -> Put:
        message = read(where, data)
        later = [*SEQUENCES, message.seq + self._chance.randrange(-50, 50)]
        return where, encoded(message, {"seq": max(self._chance.choice(later), 0)})


def read(where: str, data: bytes) -> Message:
    return decode(TOPICS[where.rsplit("/", 1)[-1]], data)


def encoded(message: Message, changed: dict[str, Any]) -> bytes:
    try:
        return encode(replace(message, **changed))
    except ValueError:
        return encode(message)
