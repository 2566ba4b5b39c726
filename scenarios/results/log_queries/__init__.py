"""Analyses of a recorded run.

explain   what a vehicle knew at an instant, and why no more
session   the scenario that repeats it, with what was changed by hand
log_info  what a log holds
recovery  a readable log from a truncated or damaged one
"""
