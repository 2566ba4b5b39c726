"""A convoy that drives, from outside: found, looked at and changed by hand.

open_runs   the runs of this user on this machine, and where to join them
answering   a vehicle that answers what it is asked to change
status      how the run goes, as its recorder answers
"""
