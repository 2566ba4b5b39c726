"""What is requested of each directed link: which rule applies to it, and the effects that follow.

rules            which entries are about a link, the most specific first
presets          shipped channels, laid under what a scenario gives
build            the effects and stages of a link, from its laws
recordings       patterns and earlier runs, read from their files into the scenario
recorded_delays  recorded delays, likewise
between          the vehicles between the ends of a link
expected         what a link should achieve by its laws
origins          which key of which rule is behind what a link did
"""
