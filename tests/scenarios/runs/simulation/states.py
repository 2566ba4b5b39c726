"""States that a simulated run reached: its reports, without names and numbers."""

import re
from collections.abc import Iterator

from tests.scenarios.runs.simulation.invariants import Aftermath
from transport.topics import RUN_SENDER
from vehicles.messages import LogText

_VARIABLE = (
    (re.compile(r"\(.*"), ""),
    (re.compile(r"/\S+/"), ""),
    (re.compile(r"\bv\d+( → v\d+)?(, v\d+( → v\d+)?)*"), "V"),
    (re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?"), "#"),
)
LONGEST = 90


def state_of(line: str) -> str:
    """A line without names and numbers."""
    for pattern, replacement in _VARIABLE:
        line = pattern.sub(replacement, line)
    return line.strip()[:LONGEST]


def states(run: Aftermath) -> Iterator[str]:
    """States of a run; a state may come several times."""
    for name in run.world.network.states:
        yield f"network: {name}"
    for process in run.world.processes:
        role = "vehicle" if process.name in run.plan.names else process.name
        yield f"{role} ended with {process.exitcode}"
        for line in process.lines:
            yield f"{role}: {state_of(line)}"
    for line in run.world.printed:
        yield f"printed: {state_of(line)}"
    for text in run.of_kind(LogText):
        if text.level != "debug" and text.vehicle == RUN_SENDER:
            yield f"log: {state_of(text.text)}"
    if run.summary is not None:
        reason = state_of(run.summary.reason)
        yield f"outcome: {run.summary.outcome}" + (f", {reason}" if reason else "")
        for link in run.summary.links:
            yield from (f"not arrived: {cause}" for cause, n in link.not_arrived.items() if n)
    for request in run.world.requests:
        answers = [each.answer for each in request.answers or ()]
        yield "change: " + (
            "no answers" if request.answers is None
            else "refused" if any(answer and answer.refused for answer in answers)
            else "partly answered" if None in answers
            else "confirmed"
        )  # fmt: skip
