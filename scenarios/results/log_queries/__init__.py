"""Analyses of a recorded run.

explain     what a vehicle knew at an instant, and why no more
session     the scenario that repeats it, with what was changed by hand
notes       notes on instants, in a file next to the log
log_info    what a log holds
log_pieces  parts of logs as logs of their own, logs joined, and damaged logs recovered
"""
