"""What `convoy reference` says is what the code has."""

import re
from dataclasses import fields
from typing import get_args

import pytest
from click.testing import CliRunner

from scenarios.cli.main import cli
from scenarios.results.summary import documented_fields
from transport.log.foxglove import standard_messages
from transport.reasons import REASONS
from transport.topics import TOPICS
from vehicles.car.parameters import VehicleParameters
from vehicles.driver.steering import SteeringCommand
from vehicles.driver.tracking import TrackingErrors
from vehicles.messages import Message


def told(what: str) -> str:
    """Output of `convoy reference WHAT` where it is 80 columns wide."""
    result = CliRunner().invoke(cli, ["reference", what], env={"COLUMNS": "80"})
    assert result.exit_code == 0, result.output
    return result.stdout


def rows(table: str) -> list[list[str]]:
    """Cells of the rows, where a row that takes several lines is one again."""
    found: list[list[str]] = []
    for line in table.splitlines():
        if line.startswith(" "):
            found[-1][-1] += f" {line.strip()}"
        else:
            found.append(re.split(r" {2,}", line.strip()))
    return found


def table(what: str, heading: str) -> list[list[str]]:
    """Rows under a heading, up to the next empty line."""
    return rows(told(what).split(f"\n{heading}\n")[1].split("\n\n")[0])


def test_fields_are_those_of_the_summary() -> None:
    for group, docs in documented_fields().items():
        assert table("fields", group) == [list(row) for row in docs.items()]


def test_topics_are_those_of_the_log_with_what_stands_beside_them() -> None:
    expected = [[name, topic.message.__name__, topic.meaning] for name, topic in TOPICS.items()]
    assert table("topics", "topics") == expected
    beside = [
        [twin.name, f"foxglove.{twin.schema.DESCRIPTOR.name}", f"as {topic.name}"]
        for topic in TOPICS.values()
        for twin in standard_messages().get(topic.message, ())
    ]
    assert table("topics", "beside them") == beside
    assert "true_gap_m" in told("topics")


def test_messages_are_told_with_all_their_fields() -> None:
    text = " ".join(told("topics").split())
    for message in get_args(Message):
        assert f"{message.__name__}: {message.__doc__.split()[0]}" in text
        assert f"fields: {', '.join(one.name for one in fields(message))}" in text


def test_reasons_are_those_of_links_and_receivers() -> None:
    _, *found = table("reasons", "reasons")
    for (word, reason), row in zip(REASONS.items(), found, strict=True):
        counts = ["lost"] * reason.counts_as_loss + ["late"] * reason.counts_as_late
        giver = "link" if reason.is_drop else "receiver"
        assert row == [word, giver, *counts, reason.meaning]


def test_the_contract_of_a_controller_is_complete() -> None:
    text = " ".join(told("controller").split())
    for word in ("Class(parameters, gains)", "steer(errors, speed)", "control.controller"):
        assert word in text
    for kind in (TrackingErrors, SteeringCommand, VehicleParameters):
        assert f"{kind.__name__}: " in text
    for one in fields(TrackingErrors):
        assert one.name in text


@pytest.mark.parametrize("what", ["fields", "topics", "reasons", "controller"])
def test_lines_fit_a_terminal(what: str) -> None:
    assert max(map(len, told(what).splitlines())) <= 80
