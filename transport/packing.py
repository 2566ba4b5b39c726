"""Serialises messages as Protobuf does, by functions made of the schema.

A run serialises a thousand messages a second for each vehicle. Filled field by field, Protobuf's
own objects take three to five times as long as one function that knows the fields of its class: all
numbers of fixed size that follow each other are packed in one call. Such a function is made of the
descriptor, as `dataclass` makes an `__init__` of the fields. The bytes are the same, see
https://protobuf.dev/programming-guides/encoding; reading is left to the library.
"""

from collections.abc import Callable
from functools import lru_cache
from struct import Struct
from typing import Any

from google.protobuf.descriptor import Descriptor, FieldDescriptor

VARINT, FIXED64, LENGTH = 0, 1, 2
"""Wire types: how the bytes of a value are told from what follows."""
REMEMBERED = 64
"""Instants, numbers and words come again and again within a tick."""


def varint(number: int) -> bytes:
    """Return a number that is not negative in groups of seven bits, the lowest first."""
    groups = bytearray()
    while number > 0x7F:
        groups.append(number & 0x7F | 0x80)
        number >>= 7
    groups.append(number)
    return bytes(groups)


@lru_cache(maxsize=REMEMBERED)
def unsigned(tag: bytes, number: int) -> bytes:
    """Pack a `uint64`."""
    if not 0 <= number < 2**64:
        raise ValueError(f"{number} is no unsigned number of 64 bits")
    return tag + varint(number)


@lru_cache(maxsize=REMEMBERED)
def signed(tag: bytes, number: int) -> bytes:
    """Pack an `int64`, which in a negative number sets all higher bits."""
    if not -(2**63) <= number < 2**63:
        raise ValueError(f"{number} is no number of 64 bits")
    return tag + varint(number & 0xFFFF_FFFF_FFFF_FFFF)


@lru_cache(maxsize=REMEMBERED)
def text(tag: bytes, characters: str) -> bytes:
    """Pack a `string`."""
    data = characters.encode()
    return tag + varint(len(data)) + data


@lru_cache(maxsize=REMEMBERED)
def _column(tag: bytes, count: int) -> tuple[bytes, Callable[..., bytes]]:
    """Return what stands before a column of so many numbers, and what packs them."""
    return tag + varint(8 * count), Struct(f"<{count}d").pack


def packed_doubles(tag: bytes, numbers: tuple[float, ...]) -> bytes:
    """Pack a column of `double`; of an empty one there is nothing."""
    if not numbers:
        return b""
    head, pack = _column(tag, len(numbers))
    return head + pack(*numbers)


def packed_counts(tag: bytes, numbers: tuple[int, ...]) -> bytes:
    """Pack a column of `uint32`; of an empty one there is nothing."""
    if not numbers:
        return b""
    if not 0 <= min(numbers) <= max(numbers) < 2**32:
        raise ValueError("a number of the column is no unsigned number of 32 bits")
    small = max(numbers) <= 0x7F  # then a byte each, as it is
    data = bytes(numbers) if small else b"".join(map(varint, numbers))
    return tag + varint(len(data)) + data


_FIXED = {FieldDescriptor.TYPE_DOUBLE: (FIXED64, "d"), FieldDescriptor.TYPE_BOOL: (VARINT, "?")}
"""Values that always take as many bytes: wire type and format."""
_MAKERS: dict[tuple[int, bool], tuple[int, Callable[[bytes, Any], bytes]]] = {
    (FieldDescriptor.TYPE_STRING, False): (LENGTH, text),
    (FieldDescriptor.TYPE_UINT64, False): (VARINT, unsigned),
    (FieldDescriptor.TYPE_INT64, False): (VARINT, signed),
    (FieldDescriptor.TYPE_DOUBLE, True): (LENGTH, packed_doubles),
    (FieldDescriptor.TYPE_UINT32, True): (LENGTH, packed_counts),
}
"""By kind of field, and whether it is a column: its wire type, and what packs tag and value."""


def packer_of(message: Descriptor) -> Callable[[object], bytes]:
    """Return what serialises any object with the attributes that the fields of `message` name.

    It writes every single value, also a zero or an empty text, as Protobuf does of `optional` ones
    that are set, and raises ValueError for an integer out of range. Raises TypeError for a schema
    with fields of a kind that no message of ours has.
    """
    names: dict[str, object] = {"join": b"".join}
    parts = []
    fixed: list[FieldDescriptor] = []
    for field in sorted(message.fields, key=lambda one: one.number):
        if not field.is_repeated and field.type in _FIXED:
            fixed.append(field)
            continue
        parts += _packed_at_once(fixed, names)
        fixed = []
        if (field.type, field.is_repeated) not in _MAKERS:
            raise TypeError(f"{field.full_name}: no way to pack such a field")
        wire_type, maker = _MAKERS[field.type, field.is_repeated]
        names[maker.__name__] = maker
        parts.append(f"{maker.__name__}({_tag(field, wire_type)!r}, message.{field.name})")
    parts += _packed_at_once(fixed, names)
    source = f"def packer(message):\n    return join(({', '.join(parts)},))"
    exec(source, names)  # noqa: S102 - made of names in our own schema
    packer: Any = names["packer"]
    return packer  # type: ignore[no-any-return]


def _packed_at_once(fields: list[FieldDescriptor], names: dict[str, object]) -> list[str]:
    """Return the call that packs values of fixed size with their tags; none if there are none."""
    if not fields:
        return []
    formats, arguments = "<", []
    for field in fields:
        wire_type, value_format = _FIXED[field.type]
        tag = _tag(field, wire_type)
        formats += f"{len(tag)}s{value_format}"
        arguments.append(f"{tag!r}, message.{field.name}")
    name = f"pack_{fields[0].number}"
    names[name] = Struct(formats).pack
    return [f"{name}({', '.join(arguments)})"]


def _tag(field: FieldDescriptor, wire_type: int) -> bytes:
    return varint(field.number << 3 | wire_type)
