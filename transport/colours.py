"""Colours of the vehicles, the same in every picture."""

Colour = tuple[int, int, int]

COLOURS: tuple[Colour, ...] = (
    (0xE4, 0x57, 0x2E),
    (0x56, 0xB4, 0xE9),
    (0x1F, 0xA9, 0x7F),
    (0xE6, 0x9F, 0x00),
    (0xCC, 0x79, 0xA7),
    (0x7D, 0x8C, 0xFF),
    (0xC9, 0xBB, 0x1E),
    (0x9A, 0x9A, 0x9A),
)
"""Colours of the lead and its followers, after Okabe and Ito: distinct for any colour vision, on
dark and light backgrounds."""


def colour_of(place: int) -> Colour:
    """Colour of the vehicle at position `place` in the convoy; after eight they repeat, darker."""
    if place == 0:
        return COLOURS[0]
    round_, place = divmod(place - 1, len(COLOURS) - 1)
    red, green, blue = COLOURS[1 + place]
    shade = (1.0, 0.6, 0.8)[round_ % 3]
    return round(shade * red), round(shade * green), round(shade * blue)
