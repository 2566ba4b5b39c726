import time

import pytest

from scenarios.runs.node.probe import NoProbe, Usage
from scenarios.runs.node.process_probe import Lateness, ProcessProbe

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
    assert probe.lateness == Lateness(4, 40 * MS)
    assert probe.read().late_ticks == 4


def test_the_memory_is_that_of_this_process() -> None:
    usage = ProcessProbe(10 * MS).read()
    assert 10e6 < usage.memory_bytes < 4e9


def test_a_process_that_computes_shows_it() -> None:
    probe = ProcessProbe(10 * MS)
    until = time.process_time() + 0.2
    while time.process_time() < until:
        pass
    busy = probe.read().cpu_ratio
    assert 0.02 < busy < 1.5  # on a loaded machine a busy process gets but a share of a core


def test_in_virtual_time_nothing_is_used_and_nothing_late() -> None:
    assert NoProbe().read() == Usage(0, 0.0, 0, 0.0)
