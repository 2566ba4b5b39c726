"""Number of examples of a property: a few by default, all in a campaign."""

from hypothesis import settings

CAMPAIGN = "campaign"
"""Hypothesis profile of `pytest --campaign`."""


def examples(few: int, everything: int) -> settings:
    whole = settings.get_current_profile_name() == CAMPAIGN
    return settings(max_examples=everything if whole else few)
