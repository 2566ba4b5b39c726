"""Limits of a run.

limit      one limit with its bound, from a scenario or the command line
problems   limits that no run could keep, or that nobody could check
"""
