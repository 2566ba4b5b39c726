import re
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from scenarios.cli.display import REDRAW_S, Progress
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.encounters import BodySize
from scenarios.results.metrics import Metrics
from scenarios.results.stream import FigureStream
from scenarios.runs import observer
from scenarios.runs.observer import LINE_EVERY_S, ThrottledObservers
from tests.made.scenarios.messages import START, gps, health, start, text, tracking, truth, verdict
from vehicles.messages import Message
from vehicles.schedule import SECOND

CONVOY = dict.fromkeys(("v1", "v2"), BodySize(5.0, 2.0, 0.0))


class Shown:
    def __init__(self, metrics: Metrics, progress: Progress) -> None:
        self._metrics = metrics
        self._progress = progress

    def listen(self, at: int, message: Message) -> None:
        self._metrics.listen(0, message)
        self._progress.listen(at, message)


@contextmanager
def shown_for(duration_s: float) -> Iterator[Shown]:
    links = {("v1", "v2"): LinkTable()}
    metrics = Metrics(tuple(CONVOY), links, stream=FigureStream(CONVOY))
    with Progress(metrics, duration_s) as progress:
        yield Shown(metrics, progress)


class FakeTime:
    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FakeTime:
    fake = FakeTime()
    monkeypatch.setattr(observer, "time", fake)
    return fake


@pytest.fixture
def plain(clock: FakeTime, monkeypatch: pytest.MonkeyPatch) -> Iterator[Shown]:
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("COLUMNS", "100")
    del clock
    with shown_for(35.0) as shown:
        yield shown


@pytest.fixture
def live(clock: FakeTime, monkeypatch: pytest.MonkeyPatch) -> Iterator[Shown]:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "80")
    del clock
    with shown_for(35.0) as shown:
        yield shown


def drive(shown: Shown, seconds: float = 12.0) -> None:
    seq = round(seconds * 50)
    shown.listen(START, truth("v1", seq - 2, -20.0, 0.0))  # v2 has passed the start of the path
    for name, error, east in (("v1", 0.02, 0.0), ("v2", -0.2, -15.0)):
        # At first v2 is 34.5 cm beside the path, then 10 cm, and estimates 20 cm.
        shown.listen(START, truth(name, seq - 1, east - 0.4, -0.345 if name == "v2" else 0.0))
        shown.listen(START, truth(name, seq, east, -0.1 if name == "v2" else 0.0))
        shown.listen(START, tracking(name, seq, lateral_error_m=error, mode="lead"))
    for number in range(5):
        shown.listen(START, verdict("v1", "v2", number))
    shown.listen(START, verdict("v1", "v2", 5, dropped="loss"))
    shown.listen(START, verdict("v1", "v2", 6, dropped="rate"))
    shown.listen(START, verdict("v1", "v2", 7, received_after_ms=90.0))
    shown.listen(START, health("v2", late_ticks=3))


def test_without_a_terminal_a_plain_line_now_and_then(
    plain: Shown, clock: FakeTime, capsys: pytest.CaptureFixture[str]
) -> None:
    plain.listen(START, start())
    assert capsys.readouterr().err == (
        "0.0 of 35.0 s · largest true error now 0.0 cm, so far 0.0 cm"
        " · delivered 0 · dropped 0 · late 0\n"
    )
    drive(plain)
    clock.now += LINE_EVERY_S - 0.1
    plain.listen(START, gps("v1", 0))
    assert capsys.readouterr().err == ""
    clock.now += 0.2
    plain.listen(START, gps("v1", 1))
    plain.listen(START, gps("v1", 2))
    out, err = capsys.readouterr()
    assert out == ""  # standard output is for results
    # dropped: without messages above the link's rate; late: messages and ticks
    assert err == (
        "12.0 of 35.0 s · largest true error now 10.0 cm, so far 34.5 cm · min gap 10.0 m"
        " · delivered 6 · dropped 1 · late 4\n"
    )


def test_a_terminal_shows_a_row_for_each_vehicle(
    live: Shown, clock: FakeTime, capsys: pytest.CaptureFixture[str]
) -> None:
    live.listen(START, start())
    drive(live)
    live.listen(START, tracking("v2", 601, lateral_error_m=0.25, mode="composite"))
    capsys.readouterr()
    clock.now += REDRAW_S
    live.listen(START, gps("v1", 0))
    err = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", capsys.readouterr().err)
    assert "12.0 of 35.0 s" in err
    lines = [line.strip() for line in err.splitlines()]
    rows = {line.split()[0]: line.split()[1:] for line in lines if re.match(r"v\d ", line)}
    # Truth first: the error now, the largest so far, the gap; then the self-estimate.
    assert rows["v1"] == ["-", "-", "-", "2.0", "lead", "20.0", "0", "0", "0"]
    assert rows["v2"] == ["-10.0", "34.5", "10.0", "25.0", "composite", "20.0", "6", "1", "4"]


def test_of_a_long_convoy_the_worst_have_a_row_and_all_a_line(
    clock: FakeTime, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "80")
    convoy = {f"v{place}": BodySize(5.0, 2.0, 0.0) for place in range(1, 41)}
    metrics = Metrics(tuple(convoy), {}, stream=FigureStream(convoy))
    with Progress(metrics, 35.0) as progress:
        shown = Shown(metrics, progress)
        shown.listen(START, start())
        shown.listen(START, truth("v1", 0, -600.0, 0.0))
        shown.listen(START, truth("v1", 1, 0.0, 0.0))
        for place, name in enumerate(convoy):
            off = 0.01 * (place % 20)  # v20 and v40 19 cm, v16 to v20 and v36 to v40 the worst ten
            if place:
                shown.listen(START, truth(name, 1, -15.0 * place, off))
        capsys.readouterr()
        clock.now += REDRAW_S
        shown.listen(START, gps("v1", 0))
        err = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", capsys.readouterr().err)
    rows = [line.split()[0] for line in map(str.strip, err.splitlines()) if re.match(r"v\d", line)]
    assert rows == [*(f"v{place}" for place in (*range(16, 21), *range(36, 41)))]
    words = " ".join(err.split())
    assert "the worst 10 of 40; all: largest true error now 19.0 cm, so far 19.0 cm" in words
    assert "min gap 10.0 m · delivered 0 · dropped 0 · late 0" in words


def test_while_the_log_catches_up_the_time_goes_on_and_the_backlog_is_shown(
    clock: FakeTime, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    waiting = [0]
    metrics = Metrics(tuple(CONVOY), {}, stream=FigureStream(CONVOY))
    with Progress(metrics, 35.0) as progress:
        throttled = ThrottledObservers([progress], lambda: waiting[0], 2000)
        throttled.listen(START, start())
        waiting[0] = 12345
        clock.now += LINE_EVERY_S
        throttled.listen(START + 3 * SECOND, truth("v1", 150, 0.0, 0.0))
        assert "3.0 of 35.0 s, log behind by 12345 messages · " in capsys.readouterr().err
        waiting[0] = 0
        clock.now += LINE_EVERY_S
        throttled.listen(START + 4 * SECOND, truth("v1", 200, 0.0, 0.0))
        assert "4.0 of 35.0 s · " in capsys.readouterr().err


def test_a_terminal_is_redrawn_at_a_limited_rate(
    live: Shown, clock: FakeTime, capsys: pytest.CaptureFixture[str]
) -> None:
    live.listen(START, start())
    capsys.readouterr()
    for _ in range(10):
        clock.now += REDRAW_S / 11
        live.listen(START, gps("v1", 0))
    assert capsys.readouterr().err == ""


def test_messages_of_the_run_and_errors_are_printed(
    plain: Shown, capsys: pytest.CaptureFixture[str]
) -> None:
    plain.listen(START, text("run", 0, "all 2 vehicles are present"))
    plain.listen(START, text("run", 1, "the router was out of reach for 1.0 s", "warning"))
    plain.listen(START, text("v1", 0, "mode path"))
    plain.listen(START, text("v2", 0, "3 late ticks", "warning"))
    plain.listen(START, text("v2", 1, "no way", "error"))
    assert capsys.readouterr().err.splitlines() == [
        "run: all 2 vehicles are present",
        "run: the router was out of reach for 1.0 s",
        "v2: no way",
    ]
