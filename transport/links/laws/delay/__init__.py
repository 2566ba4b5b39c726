"""Laws of delay beyond the floor, each a class that is the table of a scenario file.

drawn            what they have in common: order, correlation from message to message
kinds            constant, uniform, normal (truncated), lognormal, gamma, recorded delays
gamma_quantiles  the gamma law as a function of a normal number
"""
