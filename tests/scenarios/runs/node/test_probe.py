import pytest

from scenarios.runs.node.process_probe import Lateness, ProcessProbe, ThreadTimes

MS = 1_000_000


def test_a_tick_is_late_from_more_than_the_allowance_on() -> None:
    probe = ProcessProbe(10 * MS)
    for lateness in (-5 * MS, 0, 10 * MS, 10 * MS + 1, 25 * MS, 3 * MS):
        probe.tick_began(lateness)
    usage = probe.read()
    assert usage.late_ticks == 2
    assert usage.lateness_ms_max == pytest.approx(25.0)
    assert probe.read().late_ticks == 2


def test_a_restarted_process_continues_its_counts() -> None:
    probe = ProcessProbe(10 * MS, Lateness(3, 40 * MS))
    probe.tick_began(25 * MS)
    assert probe.lateness == Lateness(4, 40 * MS, at_start=1)
    assert probe.read().late_ticks == 4


def causes_of(
    *ticks: tuple[float, tuple[float, float, float]],
) -> tuple[int, int, int]:
    """Late ticks by start, network and processor, of ticks with their lateness (ms) and step.

    A step takes a time, of which it runs on a processor and waits for one.
    """
    clock = [ThreadTimes(0, 0, 0)]
    probe = ProcessProbe(10 * MS, times=lambda: clock[-1])
    for lateness, step in ticks:
        probe.tick_began(round(lateness * MS))
        spans = [round(span * MS) for span in step]
        clock.append(ThreadTimes(*map(sum, zip(clock[-1], spans, strict=True))))
        probe.tick_ended()
    late = probe.lateness
    return late.at_start, late.by_network, late.ticks - late.at_start - late.by_network


QUICK = (2.0, 2.0, 0.0)


def test_a_blocked_step_makes_the_network_late() -> None:
    assert causes_of((0, (55.0, 2.0, 1.0)), (35, QUICK), (15, QUICK), (0, QUICK)) == (0, 2, 0)


@pytest.mark.parametrize("step", [(55.0, 53.0, 0.0), (55.0, 2.0, 52.0), (55.0, 20.0, 20.0), QUICK])
def test_computing_waiting_and_oversleeping_are_the_processor_s(
    step: tuple[float, float, float],
) -> None:
    assert causes_of((0, step), (35, QUICK), (15, QUICK), (0, QUICK)) == (0, 0, 2)
