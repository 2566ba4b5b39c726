"""How a convoy goes, as tables and as JSON; and what is said where there is nothing to show."""

import io
import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from click.testing import CliRunner
from rich.console import Console

from scenarios.cli.common_options import Time
from scenarios.cli.live.change_requests import run_to_join
from scenarios.cli.live.status_tables import show, tables
from scenarios.cli.main import cli
from scenarios.definition.scenario import load_scenario
from scenarios.results.metrics import Metrics
from scenarios.runs.control.open_runs import OpenRun
from scenarios.runs.control.run_status import RunStatus, StatusBoard
from scenarios.runs.stop import Stop
from tests.made.transport import drive
from transport.bus.bus import BusError
from vehicles.messages import RunStart

NO_FLAGS: dict[str, Any] = {
    "connect": (), "listen": (), "config": None, "cfg": (), "mode": None,
}  # fmt: skip
ONE, TWO = (OpenRun(name, f"tcp/127.0.0.1:{name}", "/runs") for name in ("one", "two"))


def board() -> StatusBoard:
    """What the recorder knows after a made-up drive."""
    names = ", ".join(f'"{name}"' for name in drive.VEHICLES)
    scenario = load_scenario("lane_change", [f"convoy.names=[{names}]"])
    metrics = Metrics.of(scenario)
    found = StatusBoard(scenario, "mine", metrics)
    start = RunStart(vehicle="run", seq=0, start_at_ns=drive.START, run_id="x")
    for message in (start, *(message for _, message in drive.drive(60))):
        metrics.listen(0, message)
        found.listen(drive.START, message)
    return found


def test_the_status_has_every_vehicle_and_every_link_and_survives_the_bus() -> None:
    status = board().status(drive.START)
    assert [one.name for one in status.vehicles] == list(drive.VEHICLES)
    assert status.vehicles[0].lead is status.vehicles[0].predecessor is None
    assert all(one.lead is not None for one in status.vehicles[1:])
    assert status.at_s == pytest.approx(59 / 50, abs=0.1)
    links = [(one.sender, one.receiver) for one in status.links]
    assert links == [("v1", "v2"), ("v1", "v3"), ("v2", "v3")]
    assert RunStatus.of(status.text.encode()) == status
    json.loads(status.text, parse_constant=pytest.fail)  # no NaN, which JSON does not know


@pytest.mark.parametrize("text", [b"[]", b"{}", b"[" * 9000, b'{"vehicles": 1}', b"null"])
def test_a_status_that_is_none_is_told_apart(text: bytes) -> None:
    with pytest.raises(ValueError, match="no status of a run"):
        RunStatus.of(text)


def printed(read: Callable[[], RunStatus | None], stop: Stop, **how: Any) -> tuple[bool, str]:
    out = io.StringIO()
    console = Console(file=out, width=80)
    return show(read, console, stop, **{"every_s": None, "as_json": False, **how}), out.getvalue()


def test_it_is_shown_in_eighty_columns() -> None:
    status = board().status(drive.START)
    found, text = printed(lambda: status, Stop())
    assert found
    for name in drive.VEHICLES:
        assert sum(line.startswith(f"{name} ") for line in text.splitlines()) >= 1
    assert "…" not in text


def test_of_a_long_convoy_a_table_that_refreshes_has_the_worst() -> None:
    status = board().status(drive.START)
    one, link = status.vehicles[-1], status.links[0]
    many = replace(
        status,
        vehicles=tuple(
            replace(one, name=f"c{place}", true_error_m=-0.1 * place, hazard=place == 1)
            for place in range(40)
        ),
        links=tuple(
            replace(link, sender=f"s{place}", loss_ratio=0.01 * place) for place in range(40)
        ),
    )
    out = io.StringIO()
    Console(file=out, width=80).print(tables(many, 3))
    first = [line.split()[0] for line in out.getvalue().splitlines() if line.strip()]
    assert [word for word in first if word[0] in "cs" and word[1:].isdigit()] == [
        *("c1", "c38", "c39"),  # the one with hazard lights, then those furthest off
        *("s37", "s38", "s39"),
    ]
    assert "the worst 3 of 40 vehicles" in out.getvalue()
    assert "the worst 3 of 40 links" in out.getvalue()
    _, text = printed(lambda: many, Stop())
    assert all(f"c{place} " in text for place in range(40))  # shown once, it has all
    assert "the worst" not in text


def test_before_the_start_there_is_nothing_to_show() -> None:
    assert printed(lambda: None, Stop()) == (False, "")
    assert tables(None).renderables == ["has not started yet"]


def test_it_refreshes_until_the_run_ends_or_it_is_stopped() -> None:
    status, left = board().status(drive.START), [1, 2, 3]

    def read() -> RunStatus:
        if not left:
            raise BusError("run mine: no recorder is there")
        left.pop()
        return status

    assert printed(read, Stop(), every_s=0.01)[0]
    assert left == []
    stop = Stop()
    stop.request("stopped by SIGINT", 130)
    assert printed(lambda: status, stop, every_s=60.0)[0]


@pytest.mark.parametrize(
    ("run_name", "flags", "runs", "run", "connect"),
    [
        (None, {}, [ONE], "one", (ONE.endpoint,)),
        ("two", {}, [ONE, TWO], "two", (TWO.endpoint,)),
        ("far", {"connect": ("tcp/192.0.2.1:7447",)}, [ONE], "far", ("tcp/192.0.2.1:7447",)),
        ("one", {"connect": ("tcp/192.0.2.1:7447",)}, [ONE], "one", ("tcp/192.0.2.1:7447",)),
        ("far", {}, [ONE, TWO], "far", ()),  # with the router of a convoy started by hand
    ],
)
def test_which_run_is_meant(
    run_name: str | None,
    flags: dict[str, Any],
    runs: list[OpenRun],
    run: str,
    connect: tuple[str, ...],
) -> None:
    options = run_to_join(run_name, {**NO_FLAGS, **flags}, runs)
    assert (options.run, options.connect) == (run, connect)


@pytest.mark.parametrize(
    ("run_name", "flags", "runs", "line"),
    [
        (None, {}, [], "no run here that `convoy run` drives; give --run, and -e for its router"),
        (None, {}, [ONE, TWO], "2 runs here, give one of them by --run: one, two"),
        (None, {"connect": ("tcp/192.0.2.1:7447",)}, [ONE],
         "--run: missing, needed where the flags say how to join"),
        ("a/b", {}, [ONE], "--run 'a/b': allowed are up to 100 letters, digits, underscores and "
         "hyphens"),
    ],
)  # fmt: skip
def test_a_run_that_is_not_clear_is_a_line(
    run_name: str | None, flags: dict[str, Any], runs: list[OpenRun], line: str
) -> None:
    with pytest.raises(BusError) as refused:
        run_to_join(run_name, {**NO_FLAGS, **flags}, runs)
    assert str(refused.value) == line


@pytest.mark.parametrize(
    ("text", "seconds"), [("5s", 5.0), ("500ms", 0.5), ("2min", 120.0), ("3", 3.0), (".5 s", 0.5)]
)
def test_spans_have_units(text: str, seconds: float) -> None:
    assert Time().convert(text, None, None) == pytest.approx(seconds, rel=1e-12)


@pytest.mark.parametrize("text", ["", "-1s", "1h", "s", "1e3s", "nan", "5 5s"])
def test_a_span_that_is_none_is_a_matter_of_usage(text: str) -> None:
    result = CliRunner().invoke(cli, ["stall", "v1", "--for", text])
    assert result.exit_code == 2
    assert "--for" in result.stderr
    assert "500ms" in result.stderr
