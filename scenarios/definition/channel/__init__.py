"""What is requested of each directed link: which rule applies to it, and the effects that follow.

rules            which entries are about a link, the most specific first
presets          shipped channels, laid under what a scenario gives
build            the effects and stages of a link, from its laws; the vehicles between its ends
recordings       patterns and earlier runs, read from their files into the scenario
recorded_delays  recorded delays, likewise
expected         what a link should achieve by its laws
origins          which key of which rule is behind what a link did
"""
