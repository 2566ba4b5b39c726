"""Observers of a run whose log is behind."""

from scenarios.runs.observer import OnMessage, ThrottledObservers
from tests.made.scenarios.messages import START, gps, text
from vehicles.messages import GpsPose, LogText, Message


def test_while_the_log_is_behind_only_texts_are_shown_and_the_others_are_counted() -> None:
    seen, waiting = list[Message](), [True]
    shown = OnMessage(lambda _, message: seen.append(message), frozenset({GpsPose, LogText}))
    throttled = ThrottledObservers([shown], lambda: waiting[0])
    line, before, after = text("run", 0, "the log is behind"), gps("v1", 0), gps("v1", 1)
    throttled.listen(START, before)
    throttled.listen(START, line)
    waiting[0] = False
    throttled.listen(START, after)
    assert seen == [line, after]
    assert (throttled.skipped, throttled.kinds) == (1, shown.kinds)
