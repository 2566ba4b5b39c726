"""Studies that simulate one scenario many times.

variant        one run: scenario, overrides and seed, and the command that repeats it
statistics     confidence intervals of shares and means
boundary/      `convoy bisect`: the value of a key at which runs begin to break a limit
sweeps/        `convoy sweep`: combinations of values of several keys
blame/         `convoy blame`: the losses that caused the worst figure of a recorded run
"""
