"""Errors of a receiver's positions.

noise          white noise
drift          a Gauss–Markov process, independent of the rate
error_term     interface of all other errors
bias           a constant error
common_drift   drift shared by all receivers
fix_states     fix states over time
outages        times and places without a fix
gnss_settings  all settings of a receiver: the registry of its errors
gnss_errors    the errors over a run
stated_errors  the error model that a receiver states
"""
