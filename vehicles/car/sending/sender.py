"""A vehicle's sender."""

from collections.abc import Callable
from typing import Final

from vehicles.car.gnss import Fix
from vehicles.car.sending.congestion import ReactiveControl
from vehicles.car.sending.every_fix import EveryFix
from vehicles.car.sending.path_history import PathHistory
from vehicles.car.sending.rule import SendingTrigger

BEFORE_EVERY_RUN: Final = -(2**62)  # An instant (ns) before every run
ROUNDING: Final = 1000  # Tolerance (ns) of intervals between instants, which are rounded to 1 ns


def no_estimate(_: int) -> Fix | None:
    return None


class Sender:
    """Sends the newest fix when a rule triggers (EN 302 637-2 or simpler), each fix at most once.

    `control` limits the rate (TS 102 687). `path` records each fix for the path history.
    """

    def __init__(
        self,
        rule: SendingTrigger | None = None,
        control: ReactiveControl | None = None,
        path: PathHistory | None = None,
    ) -> None:
        self.path = path
        self._rule: SendingTrigger = rule or EveryFix()
        self._control = control
        self._unsent: Fix | None = None
        self._sent_at = BEFORE_EVERY_RUN

    def send(
        self,
        now: int,
        fix: Fix | None,
        estimate: Callable[[int], Fix | None] = no_estimate,
        *,
        on_path: bool = True,
    ) -> Fix | None:
        """Take the new fix at `now` (ns), if any; return the fix to send, if any.

        A car is `on_path` unless it announces a hazard or slows down without a source. `estimate`
        gives its position by dead reckoning, which the path history has where fixes are missing.
        """
        if fix is not None:
            self._unsent = fix
            if self.path is not None:
                self.path.record(fix, on_path=on_path)
        elif self.path is not None and self._unsent is None and self.path.misses_fixes(now):
            own = estimate(now)
            if own is not None:
                self.path.record_estimate(own, on_path=on_path)
        allowed_from = BEFORE_EVERY_RUN
        if self._control is not None:
            allowed_from = self._sent_at + self._control.min_interval(now) - ROUNDING
        if not self._rule.due(now, self._unsent, allowed_from) or self._unsent is None:
            return None
        sent, self._unsent = self._unsent, None
        self._sent_at = now
        self._rule.sent(now, sent)
        return sent
