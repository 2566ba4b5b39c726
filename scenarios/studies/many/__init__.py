"""Answers from many runs of one scenario: what is requested of each, and what they show together.

variant     one run: a scenario, overrides and a seed, and the command that repeats it
watched     a run that is watched for one limit, and ends when it is broken
statistics  intervals of confidence of shares and means
boundary/   `convoy bisect`: from which value of a key on a limit is broken
splitting   rare events by adaptive multilevel splitting, of any paths and of runs
risk        `convoy risk`: how probable it is that one run breaks a limit
sweeps/     `convoy sweep`: many values of some keys
blame/      `convoy blame`: which losses of a recorded run were to blame
"""
