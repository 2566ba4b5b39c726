"""`convoy blame`: which losses of a recorded run were to blame for its worst figure.

losses     what its log holds of losses: bursts, and those that overlap in time
imposed    its scenario with exactly the losses of a list
rerun      one run with other losses: how bad it gets, whether it breaks a limit
trials     many of them, several at once, none twice
ranking    bursts by the metres that they cost, by bisection
shrinking  the smallest set of losses that still breaks the limit, by delta debugging
study      all of it, in order
report     files: the picture, JSON, the scenario of the smallest set
"""
