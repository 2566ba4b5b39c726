"""`convoy blame`: the losses that caused the worst figure of a recorded run.

losses     losses in its log: bursts, and those that overlap in time
imposed    its scenario with exactly the losses of a list
rerun      one run with other losses: its worst figure, and whether it breaks a limit
trials     many of them, several at once, none repeated
ranking    bursts by the metres that they cost, by bisection
shrinking  the smallest set of losses that still breaks the limit, by delta debugging
study      all of it, in order
report     files: the picture, JSON, the scenario of the smallest set
"""
