"""Laws of delay beyond the floor, each a class that is the table of a scenario file.

drawn            what they have in common: order, correlation from message to message
constant         always the same
uniform          between two ends
normal           normal, truncated
lognormal        lognormal
gamma            gamma
gamma_quantiles  the gamma law as a function of a normal number
empirical        recorded delays
"""
