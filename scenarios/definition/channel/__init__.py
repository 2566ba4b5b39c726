"""The settings of each directed link, and the effects that follow.

rules            the entries that apply to a link, the most specific first
presets          shipped channels, completed by the keys of a scenario
build            effects and stages of a link from its laws; the vehicles between its ends
recordings       patterns and earlier runs, read into the scenario
recorded_delays  recorded delays, read into the scenario
expected         expected loss, bursts, delay and age of a link
origins          the key of the rule behind a dropped message
"""
