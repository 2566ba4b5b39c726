"""The page of `--serve` in a real browser: during and after a run, and in a review."""

import re
import signal
from pathlib import Path

import pytest

from tests.system.processes import Process, start, until
from tests.system.viewers.browser import CHROMIUM, Browser, browser
from transport.panels import colour_of

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")

VEHICLES = 3
SCENARIO = f"""
name = "long"
duration_s = 120.0
[convoy]
vehicles = {VEHICLES}
[path]
kind = "segments"
segments = [{{ length_m = 3000.0 }}]
[speed]
set_mps = 20.0
"""
"""Long enough for a slow machine to load the page."""
FEWEST_PIXELS = 60
"""Pixels of a car's colour: a car (35 by 13 pixels) has more, a curve alone has fewer."""
PATIENCE_S = 60.0


def shows_cars(page: Browser) -> bool:
    """Whether the page has pixels of every car's colour."""
    colours = {colour: count for count, colour in page.picture().getcolors(maxcolors=2**24)}
    return all(colours.get(colour_of(place), 0) > FEWEST_PIXELS for place in range(VEHICLES))


def description(page: Browser, process: Process) -> str:
    """Describe a page that does not show the cars."""
    colours = sorted(page.picture().getcolors(maxcolors=2**24), reverse=True)[:10]
    return f"{colours=}\n{process.exit_code=}\n{process.out}\n{process.err}"


def destination(process: Process) -> str:
    """Wait until a command prints an address."""

    def printed() -> list[str]:
        return re.findall(r"http://127\.0\.0\.1:\S+", process.err + process.out)

    assert until(lambda: bool(printed()) or process.exit_code is not None)
    assert process.exit_code is None, process.err
    return f"{printed()[0]}&renderer=webgl"  # works without a graphics card


@pytest.mark.long
def test_the_page_shows_the_convoy_during_and_after_a_run_and_in_a_review(tmp_path: Path) -> None:
    (tmp_path / "long.toml").write_text(SCENARIO)
    with browser() as page:
        page.open("data:text/html,empty")
        assert not shows_cars(page)
        with start("run", "long.toml", "--serve", "--out=run", folder=tmp_path) as run:
            address = destination(run)
            run.await_start()
            page.open(address)
            assert until(lambda: shows_cars(page), PATIENCE_S), description(page, run)
            assert run.exit_code is None  # still running
            run.popen.send_signal(signal.SIGINT)
            assert run.wait() == 130
            assert shows_cars(page)  # loaded data stays
        page.open("data:text/html,empty again")
        assert until(lambda: not shows_cars(page), PATIENCE_S)
        with start("review", "run", "--serve", folder=tmp_path) as reviewing:
            page.open(destination(reviewing))
            assert until(lambda: shows_cars(page), PATIENCE_S), description(page, reviewing)
            reviewing.popen.send_signal(signal.SIGINT)
            assert reviewing.wait() == 130
