"""Which vehicles each vehicle receives from."""

from collections.abc import Sequence


def senders_to(names: Sequence[str], receiver: str) -> tuple[str, ...]:
    """Vehicles whose poses `receiver` uses, of a convoy of `names`: the lead and its predecessor.

    The lead has no senders, the first follower the lead alone.
    """
    place = names.index(receiver)
    return tuple(dict.fromkeys((names[0], names[place - 1]))) if place else ()


def directed_links(names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Sender and receiver of every link, by receiver from the lead back."""
    return tuple((sender, receiver) for receiver in names for sender in senders_to(names, receiver))
