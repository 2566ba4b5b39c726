"""Log messages of a decision."""

from scenarios.runs.node.decision_messages import (
    command_message,
    tracking_message,
    trajectory_message,
)
from vehicles.driver.decision import Decision
from vehicles.messages import Message


def log_messages(decision: Decision, vehicle: str, seq: int, now: int) -> tuple[Message, ...]:
    always = (
        tracking_message(decision, vehicle, seq, now),
        command_message(decision, vehicle, seq, now),
    )
    if decision.fit is None:
        return always
    return *always, trajectory_message(decision, decision.fit, vehicle, seq, now)
