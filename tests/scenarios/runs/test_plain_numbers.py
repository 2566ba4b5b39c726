"""What is sent are Python's own numbers: those of NumPy are slower, and other bytes to a pipe."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from scenarios.definition.library import library
from scenarios.definition.scenario import load_scenario
from scenarios.runs.observer import OnMessage
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from vehicles.messages import Message

PLAIN = {bool, float, int, str}


@pytest.mark.spread(6)
@pytest.mark.parametrize("name", library())
@pytest.mark.parametrize(
    "overrides",
    [(), ("gnss.rate_hz=5", "gnss.position_noise_m=0.5", "control.estimate_slip=true")],
    ids=["as shipped", "noisy"],
)
def test_messages_hold_plain_numbers(name: str, overrides: tuple[str, ...], tmp_path: Path) -> None:
    messages: list[Message] = []
    scenario = load_scenario(name, (*overrides, "duration_s=2"), 1)
    keep = OnMessage(lambda _, one: messages.append(one))
    run_virtual(scenario, tmp_path, Stop(), observers=[keep])
    assert len(messages) > 500
    odd = set()
    for message in messages:
        for field in fields(message):
            value: Any = getattr(message, field.name)
            kinds = {type(one) for one in value} if type(value) is tuple else {type(value)}
            odd |= {(type(message).__name__, field.name, kind.__name__) for kind in kinds - PLAIN}
    assert odd == set()
