"""What is asked of each directed link: which rule applies to it, and the effects that follow.

rules       which entries are about a link, the most specific first
presets     shipped channels, laid under what a scenario says
build       the effects of a link, from its table
outages     when and where it carries nothing
loss        those that lose messages, and what keys of them do not fit together
recordings  patterns and earlier runs, read from their files into the scenario
radio       those of its radio
delay       laws of delay, queue and order; recorded delays are read here
content     copies, messages held back, wrong bits, false content
reach       what a radio loses over a distance, by its law
expected    what a link should achieve by its laws
origins     which key of which rule is behind what a link did
"""
