"""What is asked of each directed link: which rule applies to it, and the effects that follow.

rules    which entries are about a link, the most specific first
build    the effects of a link, from its table
radio    those of its radio
presets  shipped channels, laid under what a scenario says
"""
