"""What radios lose over a distance, by quadrature, against their effects."""

from math import sqrt

import pytest

from scenarios.definition.channel.build import link_effects
from scenarios.definition.channel.presets import presets
from scenarios.definition.scenario import load_scenario
from transport.links.laws.link_law import Position, Road, TransmissionContext, VehiclesBetween
from transport.links.link import Link

FAR_APART_M = 1000.0
"""Metres driven from message to message, over which the shadowing is another."""
STRAIGHT = Road(1.0, (0.0, 1.0), (0.0, 0.0))


@pytest.mark.parametrize("name", [name for name in presets() if "nlosv" in name])
@pytest.mark.parametrize(("count", "distance"), [(0, 1800.0), (3, 250.0)])
@pytest.mark.campaign(200, 5000)
def test_path_loss_delivers_its_mean_over_the_shadowing(
    name: str, count: int, distance: float, campaign: int
) -> None:
    table = load_scenario("lane_change", [f"links.preset={name}"]).links["v1", "v2"]

    def between() -> VehiclesBetween:
        return VehiclesBetween(count, STRAIGHT, distance, 0.0)

    effects = link_effects(table, 20.0, between=between)
    link = Link(effects, 1, "v1", "v2")
    radio = next(one for one in effects if one.key == "radio")
    losses = radio.losses(distance)
    assert losses is not None
    loss = losses.loss
    lost = 0
    for seq in range(campaign):
        driven = seq * FAR_APART_M
        sender = Position(driven + distance, 0.0, driven)
        context = TransmissionContext(seq, 0, 124, sender, Position(driven, 0.0, driven))
        lost += link.judge(context).outcome == "dropped"
    error = sqrt(max(loss * (1.0 - loss), 1e-4) / campaign)
    assert abs(lost / campaign - loss) < 4.0 * error + 0.002
