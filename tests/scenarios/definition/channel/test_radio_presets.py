"""The radio presets deliver what is published, at every distance of their tables and in between."""

from itertools import pairwise
from math import sqrt

import pytest

from scenarios.definition.channel.build import link_effects
from scenarios.definition.scenario import load_scenario
from transport.links.laws.link_law import Position, TransmissionContext
from transport.links.laws.shared_channel import TableRadio
from transport.links.link import Link

METRES_80211P = (0, 25, 50, 75, 100, 125, 150, 175, 200, 250, 300, 350, 400)
METRES_LTE = (25, 50, 100, 150, 200, 250, 300, 400, 500)
DENSE_LTE = (961, 933, 873, 778, 640, 480, 354, 164, 53)
# In thousandths, from the papers' figures: Sepulcre et al., arXiv 2104.07923, and Gonzalez-Martín
# et al., arXiv 1807.06508.
PUBLISHED = {
    "ieee80211p_light": (
        METRES_80211P, (983, 982, 976, 971, 963, 947, 928, 900, 852, 628, 297, 91, 20),
    ),
    "ieee80211p_dense": (
        METRES_80211P, (919, 908, 885, 857, 811, 746, 662, 574, 481, 281, 114, 31, 6),
    ),
    "ieee80211p_jam": (
        METRES_80211P, (809, 769, 697, 626, 524, 406, 291, 199, 130, 48, 14, 3, 0),
    ),
    "lte_v2x_light": (METRES_LTE, (989, 986, 980, 976, 970, 957, 937, 856, 644)),
    "lte_v2x_dense": (METRES_LTE, DENSE_LTE),
    "lte_v2x_oneshot": (METRES_LTE, DENSE_LTE),
}  # fmt: skip
HELD = {"lte_v2x_light": 10.0 / 0.6, "lte_v2x_dense": 20.0 / 0.6, "lte_v2x_oneshot": 4.0}
"""Messages that share their fate, on average."""


def points(name: str) -> dict[float, float]:
    """Distances and shares that are published, and those half-way between."""
    metres, thousandths = PUBLISHED[name]
    table = {float(way): share / 1000.0 for way, share in zip(metres, thousandths, strict=True)}
    half = {0.5 * (near + far): 0.5 * (table[near] + table[far]) for near, far in pairwise(table)}
    return table | half


def link(name: str, seed: int) -> Link:
    """The link of a scenario that names the preset."""
    link = load_scenario("lane_change", [f"links.preset={name}"]).links["v1", "v2"]
    return Link(link_effects(link, 20.0), seed, "v1", "v2")


def delivered(link: Link, way: float, messages: int) -> float:
    """Share of messages delivered over a distance that stays the same."""
    sender, receiver = Position(3.0, 4.0 + way, way), Position(3.0, 4.0, 0.0)
    outcomes = [
        link.judge(TransmissionContext(seq, 0, 90, sender, receiver)).outcome
        for seq in range(messages)
    ]
    return outcomes.count("delivered") / messages


@pytest.mark.spread(3)
@pytest.mark.campaign(1_200, 100_000)
@pytest.mark.parametrize("name", PUBLISHED)
def test_a_preset_delivers_what_is_published(name: str, campaign: int) -> None:
    """Within 0.02 in the campaign, on three seeds together; always within sampling error.

    Messages with a common fate count as one: the mean length of a reservation that a message is in
    is at most twice the mean length.
    """
    links = [link(name, seed) for seed in (1, 2, 3)]
    found = points(name)
    assert len(found) >= 10
    independent = 3 * campaign / (2.0 * HELD.get(name, 0.5))
    for way, share in found.items():
        achieved = sum(delivered(one, way, campaign) for one in links) / 3.0
        chance = 4.5 * sqrt(share * (1.0 - share) / independent) + 1e-3
        assert abs(achieved - share) < min(chance, 0.02 if campaign >= 100_000 else 1.0), way


@pytest.mark.parametrize("name", PUBLISHED)
def test_its_law_is_the_published_table_exactly(name: str) -> None:
    law = next(one for one in link(name, 1).effects if isinstance(one, TableRadio))
    for way, share in points(name).items():
        assert law.ratio(way) == pytest.approx(share, abs=1e-12)
    held = law.reservations
    assert HELD.get(name) == (held and pytest.approx(held.mean_messages))
