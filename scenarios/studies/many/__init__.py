"""Answers from many runs of one scenario: what is asked of each, and what they say together.

blame/     which losses of a recorded run were to blame
variant    one run: a scenario, overrides and a seed, and the command that repeats it
limit      what a run must hold: a lane, a gap, an error, no collision
intervals  of what is estimated from a number of runs
engine/    who does hundreds of runs, and how they survive kills
sweeps/    `convoy sweep`: many values of some keys
"""
