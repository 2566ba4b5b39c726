"""What is asked of each directed link: which rule applies to it, and the effects that follow.

rules       which entries are about a link, the most specific first
build       the effects of a link, from its table
loss        those that lose messages, and what keys of them do not fit together
recordings  patterns and earlier runs, read from their files into the scenario
delay       laws of delay, queue and order; recorded delays are read here
outages     when and where it carries nothing
content     copies, messages held back, wrong bits, false content
expected    what a link should achieve by its laws
origins     which key of which rule is behind what a link did
"""
