"""A vehicle's sender."""

from typing import Final

from vehicles.car.gnss import Fix
from vehicles.car.sending.congestion import ReactiveControl
from vehicles.car.sending.every_fix import EveryFix
from vehicles.car.sending.rule import SendingCourse

LONG_AGO: Final = -(2**62)
"""An instant (ns) before every run."""
ROUNDING: Final = 1000
"""Instants are rounded to 1 ns: a span may be shorter than asked for by so much (ns)."""


class Sender:
    """Sends the newest fix at the instants of a rule (EN 302 637-2 or simpler), none twice.

    `control` keeps messages apart (TS 102 687), if there is such.
    """

    def __init__(
        self, rule: SendingCourse | None = None, control: ReactiveControl | None = None
    ) -> None:
        self._rule: SendingCourse = rule or EveryFix()
        self._control = control
        self._waiting: Fix | None = None
        self._sent_at = LONG_AGO

    def send(self, now: int, fix: Fix | None) -> Fix | None:
        """Take the fix known since `now` (ns), if there is one; returns what is sent at `now`.

        Instants must not go back (EN 302 637-2, TS 102 687).
        """
        if fix is not None:
            self._waiting = fix
        opens = LONG_AGO
        if self._control is not None:
            opens = self._sent_at + self._control.quiet(now) - ROUNDING
        if not self._rule.due(now, self._waiting, opens) or self._waiting is None:
            return None
        sent, self._waiting = self._waiting, None
        self._sent_at = now
        self._rule.sent(now, sent)
        return sent
