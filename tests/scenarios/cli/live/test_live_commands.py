"""Confirmations of live commands."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from click.testing import CliRunner

from scenarios.cli import change_requests
from scenarios.cli.change_requests import VehicleAnswer
from scenarios.cli.main import cli
from scenarios.runs.live_control import Confirmation
from scenarios.runs.open_runs import OpenRun

ONLY = OpenRun("only-1", "tcp/127.0.0.1:1", "/data/runs/only")


@contextmanager
def joined(run_name: str | None, flags: dict[str, Any]) -> Iterator[tuple[None, str]]:  # noqa: ARG001
    yield None, run_name or ONLY.run


@pytest.mark.parametrize(("arguments", "named"), [([], True), (["--run", ONLY.run], False)])
def test_a_confirmation_names_the_run_unless_the_command_does(
    arguments: list[str], named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = VehicleAnswer("v2", Confirmation("v2", 1.0, "all links cut"), 3.0)
    monkeypatch.setattr(change_requests, "joined", joined)
    monkeypatch.setattr(change_requests, "open_runs", lambda: [ONLY])
    monkeypatch.setattr(change_requests, "request_change", lambda *_: [answer])
    result = CliRunner().invoke(cli, ["cut", *arguments])
    assert result.exit_code == 0, result.output
    assert "v2: all links cut" in result.stdout
    assert (ONLY.run in result.stdout) == (ONLY.folder in result.stdout) == named
