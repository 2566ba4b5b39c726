"""Answers from many runs of one scenario.

variant     one run: a scenario, overrides and a seed, and the command that repeats it
watched     a run that ends when it breaks a limit
statistics  intervals of confidence of shares and means
boundary/   `convoy bisect`: the value of a key at which runs begin to break a limit
splitting   probabilities of rare events by adaptive multilevel splitting
risk        `convoy risk`: how probable it is that one run breaks a limit
sweeps/     `convoy sweep`: many values of some keys
blame/      `convoy blame`: the losses that caused the worst figure of a recorded run
"""
