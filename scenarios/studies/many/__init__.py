"""Answers from many runs of one scenario.

variant        one run: a scenario, overrides and a seed, and the command that repeats it
limit_history  one run and one limit: how near the run came, and when
statistics     confidence intervals of shares and means
boundary/      `convoy bisect`: the value of a key at which runs begin to break a limit
splitting      probabilities of rare events by adaptive multilevel splitting
risk           `convoy risk`: the probability that a run breaks a limit
sweeps/        `convoy sweep`: several values of one or more keys
blame/         `convoy blame`: the losses that caused the worst figure of a recorded run
"""
