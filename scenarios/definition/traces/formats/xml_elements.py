"""Elements of XML files, up to their first damage."""

import re
from collections.abc import Callable, Mapping
from typing import Final
from xml.parsers import expat  # reads no external entities, and NOT_AN_ENTITY leaves no others

from scenarios.definition.traces.formats.text import CONTROLS

CHUNK_BYTES: Final = 1_000_000

NOT_AN_ENTITY: Final = re.compile(rb"&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[0-9a-fA-F]+);)")
"""A sign & that begins none of the entities of XML itself."""

Starts = Mapping[str, Callable[[dict[str, str]], None]]
Ends = Mapping[str, Callable[[str], object]]


def read_elements(text: str, starts: Starts, ends: Ends, damaged: Callable[[str], None]) -> None:
    """Call `starts` with the attributes and `ends` with the text of elements by their local name.

    Damage ends the reading, and is reported to `damaged` in a line. Entities are never expanded,
    except those of XML.
    """
    data = text.encode(errors="replace").translate(None, CONTROLS)
    data = NOT_AN_ENTITY.sub(b"&amp;", data)
    data = data[max(0, data.find(b"<")) :]
    texts: list[str] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        texts.clear()
        if handle := starts.get(name.rpartition(":")[2]):
            handle(attributes)

    def end(name: str) -> None:
        if handle := ends.get(name.rpartition(":")[2]):
            handle("".join(texts))

    parser = expat.ParserCreate("utf-8")  # whatever the declaration states
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = texts.append
    view = memoryview(data)
    try:
        for begin in range(0, len(data), CHUNK_BYTES):
            parser.Parse(view[begin : begin + CHUNK_BYTES], False)
        parser.Parse(b"", True)
    except expat.ExpatError as error:
        damaged(f"damaged XML at line {error.lineno}: {expat.ErrorString(error.code)}")
