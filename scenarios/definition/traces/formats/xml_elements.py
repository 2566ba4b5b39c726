"""Elements of XML files, also of damaged ones."""

import re
from collections.abc import Callable, Collection, Mapping
from typing import Final
from xml.parsers import expat  # reads no external entities, and NOT_AN_ENTITY leaves no others

from scenarios.definition.traces.formats.text import CONTROLS

CHUNK_BYTES: Final = 1_000_000

NOT_AN_ENTITY: Final = re.compile(rb"&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[0-9a-fA-F]+);)")
"""A sign & that begins none of the entities of XML itself."""

BEGIN: Final = re.compile(
    rb"<(?:[\w.-]+:)?(?:trk|trkseg|trkpt|rte|rtept|wpt|Placemark|LineString|Track|Point)[\s/>]"
)
"""Begin of an element at which reading resumes behind damage."""

WORD_END: Final = re.compile(rb"[\s<]")

ROOT: Final = b"<all>"
"""Encloses the elements behind damage."""

MISMATCHED_TAG: Final = expat.errors.codes[expat.errors.XML_ERROR_TAG_MISMATCH]
"""Error of the parser where an element ends that began before the damage."""

Starts = Mapping[str, Callable[[dict[str, str]], None]]
Ends = Mapping[str, Callable[[str], object]]


def read_elements(
    text: str,
    starts: Starts,
    ends: Ends,
    damaged: Callable[[str], None],
    words: Collection[str] = (),
) -> None:
    """Call `starts` with the attributes and `ends` with the text of elements by their local name.

    Damage is reported to `damaged` in a line; reading resumes at the next point, line or track, or
    at the next word of an element of `words`. Entities are never expanded, except those of XML.
    """
    data = text.encode(errors="replace").translate(None, CONTROLS)
    data = NOT_AN_ENTITY.sub(b"&amp;", data)
    at, line, counted = max(0, data.find(b"<")), 1, 0
    root = b""
    while error := _read_on(data, at, root, starts, ends):
        code, index, opened = error
        if not (root and code == MISMATCHED_TAG):
            line += data.count(b"\n", counted, index)
            counted = index
            damaged(f"damaged XML at line {line}: {expat.ErrorString(code)}")
        within = opened.rpartition(":")[2] in words
        resumed = (WORD_END if within else BEGIN).search(data, max(index, at + 1))
        if resumed is None:
            return
        at, root = resumed.start(), ROOT + (f"<{opened}>".encode() if within else b"")


def _read_on(
    data: bytes, at: int, root: bytes, starts: Starts, ends: Ends
) -> tuple[int, int, str] | None:
    """Read from byte `at` to the end, or return an error: number, byte and the open element."""
    texts: list[str] = []
    opened = ""
    start_of: dict[str, Callable[[dict[str, str]], None] | None] = {}
    end_of: dict[str, Callable[[str], object] | None] = {}

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal opened
        opened = name
        texts.clear()
        try:
            handle = start_of[name]
        except KeyError:
            local = name.rpartition(":")[2]
            handle = start_of[name] = starts.get(local)
            end_of[name] = ends.get(local)
        if handle:
            handle(attributes)

    def end(name: str) -> None:
        nonlocal opened
        opened = ""
        handle = end_of[name]
        if handle:
            handle("".join(texts))

    parser = expat.ParserCreate("utf-8")  # whatever the declaration states
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = texts.append
    view = memoryview(data)
    try:
        parser.Parse(root, False)
        for begin in range(at, len(data), CHUNK_BYTES):
            parser.Parse(view[begin : begin + CHUNK_BYTES], False)
        if not root:
            parser.Parse(b"", True)
    except expat.ExpatError as error:
        index = max(at, min(at + parser.ErrorByteIndex - len(root), len(data)))
        name = opened
        if opened:
            texts[:] = [_without_last_word("".join(texts))]
            end(opened)
        return error.code, index, name
    return None


def _without_last_word(text: str) -> str:
    """Remove the word at the end of a text, which may be cut."""
    if not text or text[-1].isspace():
        return text
    return text[: -len(text.rsplit(None, 1)[-1])]
