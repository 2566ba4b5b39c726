"""What a recorder keeps of a run does not grow with it."""

import gc
import tracemalloc
from pathlib import Path

import pytest

from scenarios.definition.scenario import scenario_from_text
from scenarios.runs.live import LiveRun
from scenarios.runs.run_log import RunLog
from tests.made.scenarios.long_drive import TENTH_S, sent_in
from tests.made.scenarios.messages import START, STRAIGHT, at
from transport.codec import encode
from transport.topics import TOPIC_OF, key
from vehicles.messages import Message
from vehicles.schedule import SECOND

LATER = 40
"""Tenths of a second between two looks, after as many to begin with."""
GROWTH_BYTES = 50
"""Of each message: 10 are the mcap package's index of chunks, 30 the lead's path, which is kept;
sets of numbers and all messages that are kept whole would make it 150."""


def open_run(folder: Path) -> RunLog:
    scenario = scenario_from_text(f"{STRAIGHT}\n[convoy]\nvehicles = 2\n", label="test")
    live = LiveRun(scenario)
    run = RunLog(scenario, folder, clock="wall", run_id="test", live=live, observers=[live])
    run.start(START - SECOND, START)
    return run


def accept(run: RunLog, message: Message, now: int) -> None:
    run.recorder.accept(key(message.vehicle, TOPIC_OF[type(message)]), encode(message), now)


def record(run: RunLog, first: int, last: int) -> int:
    """Record some tenths of a second; returns how many messages these were."""
    count = 0
    for tenth in range(first, last):
        for message in sent_in(tenth, vehicles=2):
            accept(run, message, at((tenth + 1) * TENTH_S))
            count += 1
        if tenth % 4 == 0:
            run.flush()
            run.update(at(tenth * TENTH_S))
    return count


def test_each_message_leaves_little_memory_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenarios.runs.live.WINDOW_NS", SECOND)  # to see it forget
    run = open_run(tmp_path / "run")
    tracemalloc.start()
    try:
        record(run, 0, LATER)
        run.flush()
        gc.collect()
        before, _ = tracemalloc.get_traced_memory()
        count = record(run, LATER, 2 * LATER)
        run.flush()
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert not run.recorder.rejected
    print(f"{(after - before) / count:.1f} bytes of each of {count} messages")
    assert after - before < GROWTH_BYTES * count
    run.end(START + SECOND, "")
    run.close(START + SECOND)
