"""A branched run is identical up to the branch, and has other random numbers after it."""

from collections import Counter

import pytest

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.node.sink import BusSink
from scenarios.runs.virtual.virtual_convoy import Branch, VirtualConvoy
from tests.made.channels.laws import random_outage
from transport.links.laws.effect import TransmissionContext
from transport.links.laws.loss.chains import CoupledChain
from transport.links.link import Link
from vehicles.messages import GpsPose, LinkVerdict, Message
from vehicles.schedule import SECOND

CHANNELS = {
    "losses and jitter": ["links.loss_ratio=0.4"],
    "bursts": [
        "links.loss_ratio=0",
        "links.loss={kind='gilbert_elliott', loss_ratio=0.5, burst_messages_mean=4}",
    ],
    "a queue, in order": [
        "links.jitter_ms=0",
        "links.queue={bytes_per_s=3000.0, depth_messages=3}",
        "links.delay={kind='gamma', mean_ms=60.0, deviation_ms=30.0, order='in_order'}",
    ],
    "an inertial sensor": ["control.own_state='estimated'", "links.loss_ratio=0.1"],
    "a restart of the software": [
        "change=[{kind='crash', at_s=0.3, vehicle='v1', for_s=1.0}]",
    ],
}


def sent(scenario: Scenario, *branches: Branch) -> list[tuple[int, bytes, Message]]:
    """Sending times and messages of a run."""
    convoy = VirtualConvoy(scenario, branches)
    found: list[tuple[int, bytes, Message]] = []

    def on_sent(_: object, data: bytes, message: Message) -> None:
        found.append((convoy.clock.now(), data, message))

    convoy.build(lambda vehicle: BusSink(vehicle, convoy.bus, on_sent))
    convoy.run()
    return found


def short(channel: str) -> Scenario:
    own = ["duration_s=2.0", "convoy.vehicles=3", *CHANNELS[channel]]
    return load_scenario("lossy_lane_change", own)


@pytest.mark.spread(3)
@pytest.mark.parametrize("channel", CHANNELS)
def test_a_branch_changes_only_what_follows(channel: str) -> None:
    scenario = short(channel)
    at = scenario.start_at_ns + SECOND
    plain, branched = sent(scenario), sent(scenario, Branch(at, 77))
    assert [one[:2] for one in plain if one[0] <= at] == [
        one[:2] for one in branched if one[0] <= at
    ]
    for kind in (GpsPose, LinkVerdict):
        mine, others = (
            [data for when, data, message in run if when > at and isinstance(message, kind)]
            for run in (plain, branched)
        )
        assert len(mine) > 20
        assert mine != others
    # The same branch repeats the run; another seed does not.
    assert [one[:2] for one in sent(scenario, Branch(at, 77))] == [one[:2] for one in branched]
    assert [one[:2] for one in sent(scenario, Branch(at, 78))] != [one[:2] for one in branched]


def test_a_branch_at_the_run_s_own_seed_changes_no_link() -> None:
    """Keyed random numbers are the same; streams of noise restart."""
    scenario = short("losses and jitter")
    at = scenario.start_at_ns + SECOND

    def verdicts(*branches: Branch) -> Counter[tuple[str, str, int, str, int]]:
        return Counter(
            (one.vehicle, one.sender, one.pose_seq, one.outcome, one.visible_at_ns)
            for _, _, one in sent(scenario, *branches)
            if isinstance(one, LinkVerdict)
        )

    assert verdicts() == verdicts(Branch(at, scenario.seed))


def test_a_second_branch_keeps_the_effect_of_the_first() -> None:
    scenario = short("losses and jitter")
    first, second = (Branch(scenario.start_at_ns + k * SECOND // 2, 7 * k) for k in (1, 2))
    once, twice = sent(scenario, first), sent(scenario, first, second)
    same = [one[:2] for one in once if one[0] <= second.at]
    assert same == [one[:2] for one in twice if one[0] <= second.at]
    assert once[len(same) :] != twice[len(same) :]


def test_a_chain_keeps_its_state_at_a_branch() -> None:
    """Bursts have a thousand messages: new random states would differ in half of the cases."""
    stay = 0.999
    chain = CoupledChain([(stay, 1.0 - stay), (1.0 - stay, stay)], 0)
    kept = 0
    for seed in range(60):
        link = Link((), seed, "v0", "v1")
        before = chain.state_at(link.draw, 49)
        link.redraw(50, 1000 + seed)
        assert chain.state_at(link.draw, 49) == before
        kept += chain.state_at(link.draw, 50) == before
    assert kept >= 57


def test_random_outages_continue_at_a_branch() -> None:
    """They are keyed by cells of time that extend over the branch."""
    outage = random_outage(3 * SECOND, 2 * SECOND, 0)
    link = Link((outage,), 5, "v0", "v1")
    contexts = [TransmissionContext(number, number * SECOND // 20) for number in range(2000)]
    before = [link.judge(one) for one in contexts]
    assert len({one.reason for one in before}) == 2
    link.redraw(10, 6)
    assert [link.judge(one) for one in contexts] == before
