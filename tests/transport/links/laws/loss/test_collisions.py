"""Persistent collisions: a reservation loses all of its messages or none."""

from itertools import groupby

from tests.made.channels.laws import collisions, long_run
from transport.links.laws.link_law import TransmissionContext
from transport.links.link import keyed_draw


def test_all_messages_of_a_reservation_share_its_fate() -> None:
    law, draw = collisions(0.3), keyed_draw(3, "a", "b")
    fates = [law.judge(draw, TransmissionContext(seq, 0)) for seq in range(20_000)]
    assert set(fates) == {0, "collision"}
    runs = [sum(1 for _ in some) for _, some in groupby(fates)][1:-1]
    assert min(runs) >= 5


def test_no_loss_and_total_loss_are_exact() -> None:
    draw = keyed_draw(1, "a", "b")
    for loss, fate in ((0.0, 0), (1.0, "collision")):
        law = collisions(loss, 0.5)
        assert {law.judge(draw, TransmissionContext(seq, 0)) for seq in range(500)} == {fate}
    assert long_run(collisions(0.0))[1] is None
    assert long_run(collisions(1.0))[1] == float("inf")
