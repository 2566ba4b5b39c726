"""`convoy blame`: which losses of a recorded run were to blame for what became of it.

losses     what its log says was lost: bursts, and those that overlap in time
imposed    its scenario with exactly the losses that one says
rerun      one run with other losses: how bad it gets, whether it breaks a limit
parting    many of them, whose beginnings are driven once
trials     many of them, several at once, none twice
ranking    bursts by the metres that they cost, by bisection
ddmin      delta debugging: the smallest part of a set that still does what the set does
shrinking  the smallest set of losses that still breaks the limit
study      all of it, in order
report     files: scenario of the smallest set, JSON
picture    the picture
"""
