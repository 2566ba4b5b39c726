"""Laws of the delay beyond the link's minimum latency, each the table of a scenario file.

base             base classes: order of arrival, correlation between messages
distributions    constant, uniform, normal (truncated), lognormal, gamma, empirical
gamma_quantiles  quantiles of the gamma distribution
"""
