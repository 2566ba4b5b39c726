"""Picture and progress skip messages while the log catches up."""

from scenarios.runs.observer import OnMessage, ThrottledObservers
from tests.made.scenarios.messages import START, start, text, tracking, truth
from vehicles.messages import Message


def test_while_the_log_is_behind_only_the_few_that_matter_are_shown() -> None:
    shown: list[Message] = []
    waiting = [10]
    watchers = ThrottledObservers(
        [OnMessage(lambda _, message: shown.append(message))], lambda: waiting[0], 10
    )
    ordinary: list[Message] = [truth("v1", 0, 0.0, 0.0), tracking("v1", 0)]
    important: list[Message] = [start(), text("run", 0, "all are present")]
    for message in (*ordinary, *important):
        watchers.listen(START, message)
    assert shown == [*ordinary, *important]
    assert watchers.skipped_line() == ""
    waiting[0] = 11
    shown.clear()
    for message in (*ordinary, *important):
        watchers.listen(START, message)
    assert shown == important
    assert "skipped 2 messages" in watchers.skipped_line()
    waiting[0] = 0
    watchers.listen(START, ordinary[0])
    assert shown == [*important, ordinary[0]]
