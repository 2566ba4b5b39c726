"""A vehicle's sender."""

from typing import Final

from vehicles.car.gnss import Fix
from vehicles.car.sending.congestion import ReactiveControl
from vehicles.car.sending.every_fix import EveryFix
from vehicles.car.sending.rule import SendingTrigger

BEFORE_EVERY_RUN: Final = -(2**62)
"""An instant (ns) before every run."""
ROUNDING: Final = 1000
"""Tolerance (ns) of spans between instants, which are rounded to 1 ns."""


class Sender:
    """Sends the newest fix at the instants of a rule (EN 302 637-2 or simpler), none twice.

    `control` limits the rate (TS 102 687).
    """

    def __init__(
        self, rule: SendingTrigger | None = None, control: ReactiveControl | None = None
    ) -> None:
        self._rule: SendingTrigger = rule or EveryFix()
        self._control = control
        self._waiting: Fix | None = None
        self._sent_at = BEFORE_EVERY_RUN

    def send(self, now: int, fix: Fix | None) -> Fix | None:
        """Take a new fix at `now` (ns), if any; returns the fix that is sent then, if any."""
        if fix is not None:
            self._waiting = fix
        allowed_from = BEFORE_EVERY_RUN
        if self._control is not None:
            allowed_from = self._sent_at + self._control.min_interval(now) - ROUNDING
        if not self._rule.due(now, self._waiting, allowed_from) or self._waiting is None:
            return None
        sent, self._waiting = self._waiting, None
        self._sent_at = now
        self._rule.sent(now, sent)
        return sent
