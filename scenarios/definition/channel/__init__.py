"""What is asked of each directed link: which rule applies to it, and the effects that follow.

rules    which entries are about a link, the most specific first
build    the effects of a link, from its table
delay    laws of delay, queue and order; recorded delays are read here
outages  when and where it carries nothing
"""
