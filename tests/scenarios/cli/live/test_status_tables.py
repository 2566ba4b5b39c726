"""The status of a run as tables and JSON, and the selection of the run."""

import io
import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from rich.console import Console

from scenarios.cli.change_requests import run_to_join, show, tables
from scenarios.definition.scenario import load_scenario
from scenarios.runs.live import LiveRun
from scenarios.runs.open_runs import OpenRun
from scenarios.runs.run_status import RunStatus, StatusBoard
from scenarios.runs.stop import Stop
from tests.made.transport import drive
from transport.bus.bus import BusError

NO_FLAGS: dict[str, Any] = {
    "connect": (), "listen": (), "config": None, "cfg": (), "mode": None,
}  # fmt: skip
ONE, TWO = (OpenRun(name, f"tcp/127.0.0.1:{name}", "/runs") for name in ("one", "two"))


def status_of_drive() -> RunStatus:
    names = ", ".join(f'"{name}"' for name in drive.VEHICLES)
    scenario = load_scenario("lane_change", [f"convoy.names=[{names}]"])
    live = LiveRun(scenario)
    for at, message in drive.drive(60):
        live.listen(at, message)
    assert live.update()
    return StatusBoard(scenario, "mine").status(live)


def test_the_status_has_every_vehicle_and_every_link_and_survives_the_bus() -> None:
    status = status_of_drive()
    assert [one.name for one in status.vehicles] == list(drive.VEHICLES)
    assert status.vehicles[0].lead is status.vehicles[0].predecessor is None
    assert all(one.lead is not None for one in status.vehicles[1:])
    assert status.at_s == pytest.approx(59 / 50, abs=0.1)
    links = [(one.sender, one.receiver) for one in status.links]
    assert links == [("v2", "v1"), ("v1", "v2"), ("v1", "v3"), ("v2", "v3")]
    assert RunStatus.of(status.text.encode()) == status
    json.loads(status.text, parse_constant=pytest.fail)  # no NaN, which JSON does not know


def printed(read: Callable[[], RunStatus | None], stop: Stop, **how: Any) -> tuple[bool, str]:
    out = io.StringIO()
    console = Console(file=out, width=80)
    return show(read, console, stop, **{"every_s": None, "as_json": False, **how}), out.getvalue()


def test_the_tables_fit_80_columns() -> None:
    status = status_of_drive()
    found, text = printed(lambda: status, Stop())
    assert found
    for name in drive.VEHICLES:
        assert sum(line.startswith(f"{name} ") for line in text.splitlines()) >= 1
    assert "…" not in text


def test_a_refreshing_table_of_a_long_convoy_shows_the_worst() -> None:
    status = status_of_drive()
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


def test_the_status_refreshes_until_the_run_ends_or_a_signal() -> None:
    status, left = status_of_drive(), [1, 2, 3]

    def read() -> RunStatus:
        if not left:
            raise BusError("run mine: has no recorder")
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
    ],
)
def test_flags_or_open_runs_select_the_run(
    run_name: str | None,
    flags: dict[str, Any],
    runs: list[OpenRun],
    run: str,
    connect: tuple[str, ...],
) -> None:
    options = run_to_join(run_name, {**NO_FLAGS, **flags}, runs)
    assert (options.run, options.connect) == (run, connect)


@pytest.mark.parametrize(
    ("run_name", "flags", "runs", "facts"),
    [
        (None, {}, [], ["--run", "-e"]),
        (None, {}, [ONE, TWO], ["2 runs", "--run: one, two"]),
        (None, {"connect": ("tcp/192.0.2.1:7447",)}, [ONE], ["--run: missing"]),
        ("far", {}, [ONE, TWO], ["--run far", "one, two", "-e"]),
        ("far", {}, [], ["--run far", "none", "-e"]),
        ("a/b", {}, [ONE], ["--run 'a/b': allowed"]),
    ],
)
def test_an_ambiguous_run_is_refused(
    run_name: str | None, flags: dict[str, Any], runs: list[OpenRun], facts: list[str]
) -> None:
    with pytest.raises(BusError) as refused:
        run_to_join(run_name, {**NO_FLAGS, **flags}, runs)
    assert all(fact in str(refused.value) for fact in facts)
