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
    (0xA6, 0x6A, 0x3F),
    (0x7F, 0xB8, 0x3A),
    (0xA3, 0x5F, 0xD6),
    (0x3F, 0x6F, 0xC0),
)
"""Colours of the lead and its followers, readable on dark and light backgrounds.

The first eight, after Okabe and Ito, are distinct for any colour vision.
"""


def colour_of(place: int) -> Colour:
    """Colour of the vehicle at `place` of the convoy; after twelve they repeat, darker."""
    if place == 0:
        return COLOURS[0]
    round_, place = divmod(place - 1, len(COLOURS) - 1)
    return shaded(COLOURS[1 + place], (1.0, 0.6, 0.8)[round_ % 3])


def colours_of_sources(place: int) -> list[Colour]:
    """Colours of the sources of the vehicle at `place`: the lead, then the k-th vehicle ahead."""
    return [colour_of(0), *(colour_of(max(place - ahead, 0)) for ahead in range(1, place + 1))]


def shaded(colour: Colour, brightness_ratio: float) -> Colour:
    red, green, blue = (round(brightness_ratio * part) for part in colour)
    return red, green, blue
