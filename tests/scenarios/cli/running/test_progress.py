import re
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from scenarios.cli.display import Progress
from scenarios.runs import observer
from scenarios.runs.live import LiveRun
from scenarios.runs.observer import LINE_EVERY_S
from tests.made.scenarios.messages import START, health, start, text, tracking, truth, verdict
from tests.made.scenarios.tables import straight_scenario
from vehicles.messages import Message

DURATION = ("duration_s=35",)


class Shown:
    """A run whose metrics are evaluated and shown after the messages of each `step`."""

    def __init__(self, progress: Progress, vehicles: int) -> None:
        self.progress = progress
        self._live = LiveRun(straight_scenario(vehicles, DURATION))

    def step(self, *messages: Message) -> None:
        for message in messages:
            self._live.listen(START, message)
            if type(message) in self.progress.kinds:
                self.progress.listen(START, message)
        self._live.update()
        self.progress.update(self._live)


@contextmanager
def shown_for(vehicles: int = 2) -> Iterator[Shown]:
    with Progress(straight_scenario(vehicles, DURATION)) as progress:
        yield Shown(progress, vehicles)


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
    with shown_for() as shown:
        yield shown


@pytest.fixture
def terminal(clock: FakeTime, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "80")
    del clock


def drive(seconds: float = 12.0) -> Iterator[Message]:
    seq = round(seconds * 50)
    yield truth("v1", seq - 2, -20.0, 0.0)  # v2 has passed the start of the path
    for name, error, east in (("v1", 0.02, 0.0), ("v2", -0.2, -15.0)):
        # At first v2 is 34.5 cm beside the path, then 10 cm, and estimates 20 cm.
        yield truth(name, seq - 1, east - 0.4, -0.345 if name == "v2" else 0.0)
        yield truth(name, seq, east, -0.1 if name == "v2" else 0.0)
        yield tracking(name, seq, lateral_error_m=error, mode="lead")
    for number in range(5):
        yield verdict("v1", "v2", number)
    yield verdict("v1", "v2", 5, dropped="loss")
    yield verdict("v1", "v2", 6, dropped="rate")
    yield verdict("v1", "v2", 7, received_after_ms=90.0)
    yield health("v2", late_ticks=3)


def test_without_a_terminal_a_plain_line_now_and_then(
    plain: Shown, clock: FakeTime, capsys: pytest.CaptureFixture[str]
) -> None:
    plain.step(start())
    assert capsys.readouterr().err == (
        "0.0 of 35.0 s · largest true error now 0.0 cm, so far 0.0 cm"
        " · delivered 0 · dropped 0 · late 0\n"
    )
    clock.now += LINE_EVERY_S - 0.1
    plain.step(*drive())
    assert capsys.readouterr().err == ""
    clock.now += 0.2
    plain.step()
    plain.step()
    out, err = capsys.readouterr()
    assert out == ""  # standard output is for results
    # dropped: without messages above the link's rate; late: messages and ticks
    assert err == (
        "12.0 of 35.0 s · largest true error now 10.0 cm, so far 34.5 cm · min gap 10.0 m"
        " · delivered 6 · dropped 1 · late 4\n"
    )


def rows_in(err: str) -> dict[str, list[str]]:
    """Cells of the rows of a drawn table by vehicle."""
    lines = [line.strip() for line in re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", err).splitlines()]
    return {line.split()[0]: line.split()[1:] for line in lines if re.match(r"v\d+ ", line)}


@pytest.mark.usefixtures("terminal")
def test_a_terminal_shows_a_row_for_each_vehicle(capsys: pytest.CaptureFixture[str]) -> None:
    with shown_for() as shown:
        latest = tracking("v2", 601, lateral_error_m=0.25, mode="composite")
        shown.step(start(), *drive(), latest)
        err = capsys.readouterr().err
    assert "12.0 of 35.0 s" in err
    rows = rows_in(err)
    # Truth first: the error now, the largest so far, the gap; then the self-estimate.
    assert rows["v1"] == ["-", "-", "-", "2.0", "lead", "20.0", "0", "0", "0"]
    assert rows["v2"] == ["-10.0", "34.5", "10.0", "25.0", "composite", "20.0", "6", "1", "4"]


def test_messages_of_the_run_and_errors_are_printed(
    plain: Shown, capsys: pytest.CaptureFixture[str]
) -> None:
    texts = (
        text("run", 0, "all 2 vehicles are present"),
        text("run", 1, "the router was out of reach for 1.0 s", "warning"),
        text("v1", 0, "mode path"),
        text("v2", 0, "3 late ticks", "warning"),
        text("v2", 1, "no way", "error"),
    )
    for message in texts:
        plain.progress.listen(START, message)
    assert capsys.readouterr().err.splitlines() == [
        "run: all 2 vehicles are present",
        "run: the router was out of reach for 1.0 s",
        "v2: no way",
    ]
