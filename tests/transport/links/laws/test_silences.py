"""Silences of a link: known numbers, and a receiver that looks at its clock at every tick."""

from collections.abc import Sequence
from fractions import Fraction
from math import inf, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from transport.links.laws.chains import FourState, GilbertElliott
from transport.links.laws.effect import Effect, Passage
from transport.links.laws.outages import RandomOutage
from transport.links.laws.plain import Decimation, Jitter, Latency, Loss
from transport.links.laws.silences import (
    SURE,
    Listening,
    LossChain,
    SilenceLaw,
    Silences,
    both_silent,
    counted_silences,
    loss_chain,
)
from transport.links.link import Link
from vehicles.schedule import MILLISECOND, SECOND, instant, instants

HOUR = 20 * 3600
"""Messages of an hour at 20 Hz."""


def listening(**more: object) -> Listening:
    usual: dict[str, object] = {
        "rate_hz": 20.0,
        "phase": 0,
        "delays": (20 * MILLISECOND,),
        "control_hz": 50.0,
        "listens_hz": (20.0,),
        "limit": SECOND // 2,
    }
    return Listening(**(usual | more))  # type: ignore[arg-type]


def always(_number: int) -> bool:
    return True


def chain_of(*effects: Effect, period: float = SECOND / 20) -> LossChain:
    whole = SURE
    for effect in effects:
        chain = loss_chain(effect, period)
        assert chain is not None
        whole = whole.beside(chain)
    return whole


def per_hour(*effects: Effect) -> float:
    found = SilenceLaw(chain_of(*effects), listening(), always).in_the_long_run(1)
    assert found is not None
    return HOUR * found.alarms


def looked_for(there: Sequence[tuple[int, int]], heard: Listening, until: int) -> tuple[int, int]:
    """Alarms and ticks in them, of a receiver that looks at its clock at every tick."""
    ticks = sorted({*instants(0, until, heard.control_hz), *instants(0, until, 20.0)})
    coming = sorted((visible_at, number) for number, visible_at in there)
    newest, heard_at, alarms, silent, lost = -1, None, 0, 0, False
    for now in ticks:
        while coming and coming[0][0] <= now:
            _, number = coming.pop(0)
            if number > newest:
                newest, heard_at, lost = number, now, False
        if heard_at is None or now % (SECOND // 50):
            continue
        is_lost = now - heard_at > heard.limit
        alarms, silent = alarms + (is_lost and not lost), silent + is_lost
        lost = is_lost
    return alarms, silent


@pytest.mark.parametrize(("loss", "alarms"), [(0.1, 6e-6), (0.2, 0.006), (0.4, 4.5)])
def test_independent_losses_have_the_alarms_that_are_known(loss: float, alarms: float) -> None:
    """As many as there are runs of ten losses or more: 72 000 (1 - p) p^10 an hour at 20 Hz."""
    assert per_hour(Loss(loss)) == pytest.approx(HOUR * (1.0 - loss) * loss**10, rel=1e-12)
    assert per_hour(Loss(loss)) == pytest.approx(alarms, rel=0.09)  # known to so many digits


def test_of_bursts_of_four_one_in_thirteen_is_an_alarm() -> None:
    """With mean 4 a burst lasts ten messages with chance 0.75^9, 7.5 %."""
    law = GilbertElliott.of_bursts(0.4, 4.0)
    bursts = HOUR * 0.4 / 4.0
    assert per_hour(law) / bursts == pytest.approx(0.75**9, rel=1e-12)
    assert per_hour(law) / bursts == pytest.approx(0.075, abs=5e-4)


def test_nothing_is_silent_without_loss_and_everything_with_nothing_else() -> None:
    assert per_hour(Loss(0.0)) == 0.0
    assert per_hour(Loss(1.0)) == 0.0  # nothing was ever heard
    rare = SilenceLaw(chain_of(Loss(0.0)), listening(), lambda number: number == 0)
    assert rare.after(0) == 1.0
    assert rare.silent_after(0) == inf


LAWS: list[tuple[tuple[Effect, ...], tuple[Effect, ...]]] = [
    ((Loss(0.6),), ()),
    ((GilbertElliott.of_bursts(0.4, 4.0),), ()),
    ((GilbertElliott(0.02, 0.05, bad_delivers=0.2, good_delivers=0.9),), ()),
    ((FourState(0.1, 0.15, 0.1, 0.4, 0.05),), ()),
    ((GilbertElliott.of_bursts(0.3, 3.0), Loss(0.3)), (Jitter(40 * MILLISECOND),)),
    ((RandomOutage(2 * SECOND, SECOND // 2, 0), Loss(0.2)), (Jitter(130 * MILLISECOND),)),
]


@pytest.mark.campaign(15_000, 40_000)
@pytest.mark.parametrize(("losses", "delays"), LAWS)
def test_the_law_agrees_with_a_receiver_that_looks_at_its_clock(
    losses: tuple[Effect, ...], delays: tuple[Effect, ...], campaign: int
) -> None:
    messages = campaign
    link = Link((*losses, Latency(20 * MILLISECOND), *delays), 3, "v1", "v2")
    spread = sum(one.spread for one in delays if isinstance(one, Jitter))
    each = 40 if delays else 1
    heard = listening(
        delays=tuple(20 * MILLISECOND + round((k + 0.5) / each * spread) for k in range(each))
    )
    verdicts = (link.judge(Passage(k, heard.sent_at(k))) for k in range(messages))
    there = [(k, one.visible_at) for k, one in enumerate(verdicts) if not one.reason]
    law = SilenceLaw(chain_of(*losses), heard, always)
    alarms, ticks = looked_for(there, heard, instant(0, messages, 20.0))
    expected = law.of_run(messages, 1)
    assert expected is not None
    assert alarms == pytest.approx(expected, abs=4.0 * sqrt(law.dispersion() * expected))
    counted = counted_silences(there, heard)
    assert counted.alarms == pytest.approx(alarms, abs=1)  # one may have no end
    long = law.in_the_long_run(1)
    assert long is not None
    assert counted.silent_ns == pytest.approx(ticks * SECOND / 50, abs=2 * SECOND)
    wide = 5.0 * long.silent_ns * messages * sqrt(law.dispersion() / expected)
    assert counted.silent_ns == pytest.approx(long.silent_ns * messages, abs=wide)


def test_the_number_of_alarms_varies_as_much_as_is_said() -> None:
    """Runs of a law with long good and bad times: alarms come in swarms."""
    law = GilbertElliott(0.002, 0.01, bad_delivers=0.3)
    found = SilenceLaw(chain_of(law), listening(limit=SECOND // 5), always)
    counts = []
    for seed in range(150):
        link = Link((law,), seed, "v1", "v2")
        lost = "".join(".x"[bool(link.judge(Passage(k, 0)).reason)] for k in range(4000))
        counts.append(len([run for run in lost.split(".")[1:-1] if len(run) >= 4]))
    mean = sum(counts) / len(counts)
    variance = sum((one - mean) ** 2 for one in counts) / (len(counts) - 1)
    assert found.dispersion() > 5.0
    assert variance / mean == pytest.approx(found.dispersion(), rel=0.3)
    assert SilenceLaw(chain_of(Loss(0.4)), listening(), always).dispersion() == 1.0


@given(st.floats(0.0, 0.95), st.integers(1, 12))
def test_runs_of_independent_losses_vary_less_than_a_poisson_number(loss: float, run: int) -> None:
    """Their number has the variance r - (2 n + 1) r² for each message, with the rate r."""
    rate = (1.0 - loss) * loss**run
    found = chain_of(Loss(loss)).dispersion((1.0,) * run)
    assert found == pytest.approx(1.0 - (2 * run + 1) * rate, abs=1e-9)


def test_a_link_that_carries_every_fourth_message_is_lost_after_two() -> None:
    """At 5 Hz half a second is over when two in a row are lost, the third would come too late."""
    every_fourth = Decimation(Fraction(1, 4))

    def may_pass(number: int) -> bool:
        return not isinstance(every_fourth.judge(lambda *_: 0.5, Passage(number, 0)), str)

    found = SilenceLaw(chain_of(Loss(0.3)), listening(), may_pass).in_the_long_run(4)
    assert found is not None
    assert 4.0 * found.alarms == pytest.approx(0.7 * 0.3**2, rel=1e-12)


@given(st.lists(st.tuples(st.integers(1, 5), st.integers(0, 25)), max_size=12))
def test_alarms_of_listed_losses_are_counted(runs: list[tuple[int, int]]) -> None:
    """With chance out of play the expectation is the count itself."""
    heard = listening()
    passes = [one for good, bad in runs for one in [True] * good + [False] * bad]
    law = SilenceLaw(SURE, heard, lambda number: number >= len(passes) or passes[number])
    there = [(k, heard.sent_at(k) + 20 * MILLISECOND) for k, passed in enumerate(passes) if passed]
    counted = looked_for(there, heard, heard.sent_at(len(passes)))[0]
    found = law.of_run(len(passes), None)
    assert found is not None
    assert abs(found - counted) <= (not all(passes[-12:]))  # up to one that begins at the end


def test_two_links_are_silent_together_as_often_as_chance_has_it() -> None:
    """A second link that is silent for a quarter of the time, each time for long."""
    one, other = Silences(0.01, 1e6), Silences(0.002, 0.25 * SECOND)
    assert both_silent(one, other) == pytest.approx(0.01 * 0.25 + 0.002 * 0.001)


def test_messages_that_come_late_do_not_end_a_silence() -> None:
    heard = listening()
    there = [(5, heard.sent_at(5)), (3, heard.sent_at(13)), (20, heard.sent_at(20))]
    assert counted_silences(there, heard).alarms == 1.0
