"""No loss, for a link among others that have some."""

from typing import Literal

from transport.links.laws.effect import Effect
from transport.links.laws.law import LinkLaw, LinkSetting


class NoLoss(LinkLaw):
    """No further loss, where others have some."""

    kind: Literal["none"] = "none"

    def effects(self, setting: LinkSetting) -> tuple[Effect, ...]:  # noqa: ARG002 - none
        """Return none."""
        return ()
