"""The vehicles that each vehicle receives from."""

from collections.abc import Sequence


def senders_to(
    names: Sequence[str], receiver: str, *, lead_receives: bool = False
) -> tuple[str, ...]:
    """Return the vehicles whose poses `receiver` uses: the lead and its predecessor.

    The first follower uses the lead only; the lead uses none, or all others if it waits for them or
    keeps its distance from them.
    """
    place = names.index(receiver)
    if place:
        return tuple(dict.fromkeys((names[0], names[place - 1])))
    return tuple(names[1:]) if lead_receives else ()


def directed_links(
    names: Sequence[str], *, lead_receives: bool = False
) -> tuple[tuple[str, str], ...]:
    return tuple(
        (sender, receiver)
        for receiver in names
        for sender in senders_to(names, receiver, lead_receives=lead_receives)
    )
