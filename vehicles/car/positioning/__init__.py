"""Errors of a receiver's positions.

noise         white noise
drift         a Gauss–Markov process, the same path at any rate
error_term    interface of all other errors
bias          a constant error
common_drift  drift that all receivers have in common
fix_states    states of the fix over time
outages       times and places without a fix
gnss_settings settings of a receiver: the registry of its errors
gnss_errors   the errors over a run
"""
