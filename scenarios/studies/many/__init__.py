"""Answers from many runs of one scenario: what is asked of each, and what they say together.

blame/     which losses of a recorded run were to blame
variant    one run: a scenario, overrides and a seed, and the command that repeats it
limit      what a run must hold: a lane, a gap, an error, no collision
watched    a run that is watched for one limit, and ends when it is broken
intervals  intervals of confidence of shares and quantiles
files      refuse to write over what is there
boundary/  `convoy bisect`: from which value of a key on a limit is broken
risk/      `convoy risk`: how probable it is that one run breaks a limit
engine/    who does hundreds of runs, and how they survive kills
sweeps/    `convoy sweep`: many values of some keys
"""
