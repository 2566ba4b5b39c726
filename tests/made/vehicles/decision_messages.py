"""Log messages of a decision."""

from vehicles.driver.decision import Decision
from vehicles.messages import Message


def log_messages(decision: Decision, vehicle: str, seq: int, now: int) -> tuple[Message, ...]:
    always = decision.tracking(vehicle, seq, now), decision.command(vehicle, seq, now)
    if decision.fit is None:
        return always
    return *always, decision.trajectory(decision.fit, vehicle, seq, now)
