"""Studies that simulate one scenario many times.

variant        one run: scenario, overrides and seed, and the command that repeats it
limit_history  a run that stops when it breaks a limit
statistics     confidence intervals of shares and means
boundary/      `convoy bisect`: the value of a key at which runs begin to break a limit
splitting      probabilities of rare events by adaptive multilevel splitting
risk           `convoy risk`: the probability that a run breaks a limit
sweeps/        `convoy sweep`: combinations of values of several keys
blame/         `convoy blame`: the losses that caused the worst figure of a recorded run
"""
