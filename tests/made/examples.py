"""How many examples of a property are tried: a few by default, and all in a campaign."""

from hypothesis import settings

CAMPAIGN = "campaign"
"""Profile of hypothesis that `pytest --campaign` loads."""


def examples(few: int, everything: int) -> settings:
    """Try `few` examples of a property, and `everything` with `--campaign`."""
    whole = settings.get_current_profile_name() == CAMPAIGN
    return settings(max_examples=everything if whole else few)
