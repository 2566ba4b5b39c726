"""The settings of each directed link, and the effects that follow."""
