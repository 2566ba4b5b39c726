"""Markov chains of loss: single verdicts, netem's recursions, and chains that never couple."""

from collections.abc import Callable
from math import inf
from random import Random

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.made.channels.laws import collisions, four_state, gilbert, gilbert_elliott, long_run
from transport.links.laws.burst_losses import LONGEST_LOOK_BACK, FourState, GilbertElliott
from transport.links.laws.link_law import Draw, Effect, TransmissionContext
from transport.links.link import keyed_draw

Chances = st.floats(0.0, 1.0) | st.sampled_from([0.0, 0.01, 0.5, 1.0])


@st.composite
def laws(random: st.DrawFn) -> Callable[[], Effect]:
    """Factory of a law of loss with memory, with empty caches."""
    if random(st.booleans()):
        least = random(st.integers(1, 20))
        most = least + random(st.integers(0, 20))
        loss, keep = random(Chances), random(st.floats(0.0, 0.9))
        return lambda: collisions(loss, keep, least, most)
    if random(st.booleans()):
        p, r, h, k = (random(Chances) for _ in range(4))
        made: Callable[[], Effect] = lambda: gilbert_elliott(p, r, h, k)  # noqa: E731
    else:
        p13, p31, p23 = (random(Chances) for _ in range(3))
        p32, p14 = random(st.floats(0.0, 1.0 - p31)), random(st.floats(0.0, 1.0 - p13))
        assume(p13 + p14 <= 1.0 and p31 + p32 <= 1.0)
        made = lambda: four_state(p13, p31, p32, p23, p14)  # noqa: E731
    try:
        law = made()
    except ValueError:
        assume(False)
    assert isinstance(law, GilbertElliott | FourState)
    assume(law.chain.mean_look_back < 500.0)
    return made


def judged(law: Effect, draw: Draw, seq: int) -> object:
    return law.judge(draw, TransmissionContext(seq, 0))


@given(
    made=laws(),
    seed=st.integers(0, 2**31),
    numbers=st.lists(st.integers(0, 300) | st.just(10**9), min_size=1, max_size=40),
    order=st.randoms(use_true_random=False),
)
def test_a_verdict_alone_is_the_verdict_in_the_stream_in_any_order(
    made: Callable[[], Effect], seed: int, numbers: list[int], order: Random
) -> None:
    here, there = keyed_draw(seed, "a", "b"), keyed_draw(seed, "b", "a")
    stream = made()
    streamed = {seq: judged(stream, here, seq) for seq in range(301)}
    shuffled = made()
    order.shuffle(numbers)
    for seq in numbers:
        judged(shuffled, there, seq)  # another link between
        alone = judged(made(), keyed_draw(seed, "a", "b"), seq)
        assert judged(shuffled, here, seq) == alone
        if seq in streamed:
            assert streamed[seq] == alone


def test_the_first_message_is_as_likely_lost_as_any_other() -> None:
    """Over many links: a chain that started in its good state would lose no first message."""
    n, law = 4000, gilbert(0.3, 10.0)
    for seq in (0, 1, 5):
        lost = sum(judged(law, keyed_draw(seed, "a", "b"), seq) != 0 for seed in range(n))
        assert abs(lost - 0.3 * n) < 4.0 * np.sqrt(0.3 * 0.7 * n)


# ---- netem's recursions, as in sch_netem.c


def netem_gilbert_elliott(p: float, r: float, h: float, k: float, draws: list[Draw]) -> list[bool]:
    """loss_gilb_ell(): judges by the state before the step, and starts in the good state.

    `draws` returns the draws of step and loss for each packet, by state: netem turns good below r,
    the law under test stays bad below 1 - r.
    """
    good, fates = True, []
    for draw in draws:
        step, fate = draw("step", good), draw("fate", good)
        if good:
            good = not step < p
            fates.append(fate < 1.0 - k)
        else:
            good = step < r
            fates.append(fate > h)
    return fates


@pytest.mark.parametrize(
    ("p", "r", "h", "k"),
    [(0.03, 0.25, 0.0, 1.0), (0.05, 0.3, 0.25, 0.98), (0.8, 0.7, 0.0, 1.0), (0.6, 0.9, 0.2, 0.9)],
)
def test_gilbert_elliott_is_netem_s_once_its_start_is_forgotten(
    p: float, r: float, h: float, k: float
) -> None:
    n, draw = 20_000, keyed_draw(1, "a", "b")
    law = gilbert_elliott(p, r, h, k)

    def of_packet(number: int) -> Draw:
        def drawn(purpose: str, good: int) -> float:
            # netem judges a packet before the step of the next number
            u = draw("burst", number + 1) if purpose == "step" else draw("burst fate", number)
            return u if good else 1.0 - u

        return drawn

    netem = netem_gilbert_elliott(p, r, h, k, [of_packet(number) for number in range(n)])
    ours = [judged(law, draw, seq) == "burst" for seq in range(n)]
    forgotten = next(
        seq for seq in range(1, n) if not min(p, 1 - r) <= draw("burst", seq) < max(p, 1 - r)
    )
    assert forgotten < 200
    assert ours[forgotten:] == netem[forgotten:]


def netem_four_state(
    probabilities: tuple[float, float, float, float, float],
    drawn: Callable[[int, int], float],
    n: int,
) -> list[bool]:
    """loss_4state(): starts in state 1; the new state decides about the packet."""
    p13, p31, p32, p23, p14 = probabilities
    state, fates = 1, list[bool]()
    for number in range(n):
        u = drawn(number, state)
        if state == 1:
            state = 4 if u < p14 else 3 if u < p13 + p14 else 1
        elif state == 2:
            state = 3 if u < p23 else 2
        elif state == 3:
            state = 2 if u < p32 else 1 if u < p31 + p32 else 3
        else:
            state = 1
        fates.append(state in {3, 4})
    return fates


@pytest.mark.parametrize(
    "probabilities",
    [
        (0.03, 0.2, 0.15, 0.4, 0.02),
        (0.005, 0.3, 0.1, 0.3, 0.08),
        (0.1, 0.6, 0.4, 0.7, 0.05),
        (0.04, 0.3, 0.0, 1.0, 0.0),
        (0.5, 0.5, 0.5, 0.5, 0.5),
    ],
)
def test_four_states_are_netem_s_once_its_start_is_forgotten(
    probabilities: tuple[float, float, float, float, float],
) -> None:
    """The draws of each state are rearranged to netem's order."""
    p13, p31, p32, _, p14 = probabilities
    n, draw = 20_000, keyed_draw(1, "a", "b")

    def in_netem_s_order(number: int, state: int) -> float:
        u = draw("burst", number)
        if state == 1:  # 3, 4, 1 here; 4, 3, 1 there
            return u + p14 if u < p13 else u - p13 if u < p13 + p14 else u
        if state == 3:  # 3, 2, 1 here; 2, 1, 3 there
            stays = 1.0 - p31 - p32
            return u + p31 + p32 if u < stays else u - stays
        return u

    netem = netem_four_state(probabilities, in_netem_s_order, n)
    law = four_state(*probabilities)
    ours = [judged(law, draw, seq) == "burst" for seq in range(n)]
    parted = [seq for seq in range(n) if ours[seq] != netem[seq]]
    assert max(parted, default=0) < 200
    assert 0.02 < np.mean(ours) < 0.9


# ---- Chains that never couple


@pytest.mark.parametrize(
    "made",
    [
        lambda: gilbert_elliott(1.0, 1.0),
        lambda: gilbert_elliott(1e-5, 1e-5),
        lambda: four_state(1.0, 1.0),
        lambda: four_state(0.0, 0.0, p14=1.0),
        lambda: four_state(1e-6, 1e-6),
    ],
)
def test_chains_that_never_forget_are_refused(made: Callable[[], Effect]) -> None:
    with pytest.raises(ValueError, match="past"):
        made()


def test_chains_that_end_somewhere_stay_there() -> None:
    draw = keyed_draw(1, "a", "b")
    never, always = gilbert_elliott(0.0, 0.3), gilbert_elliott(0.2, 0.0)
    assert {judged(never, draw, seq) for seq in range(200)} == {0}
    assert {judged(always, draw, seq) for seq in range(200)} == {"burst"}
    assert long_run(never) == (0.0, None)
    assert long_run(always) == (1.0, inf)
    assert long_run(four_state(0.1, 0.0, 0.0, 1.0))[1] == inf


@given(Chances, Chances)
def test_two_states_couple_as_fast_as_in_closed_form(p: float, r: float) -> None:
    history = abs(1.0 - p - r)
    try:
        chain = gilbert_elliott(p, r).chain
    except ValueError:
        assert history > 1.0 - 1.001 / LONGEST_LOOK_BACK
    else:
        expected = 1.0 / (1.0 - history) if p else 0.0  # without p it never leaves the good state
        assert chain.mean_look_back == pytest.approx(expected, rel=1e-6)
