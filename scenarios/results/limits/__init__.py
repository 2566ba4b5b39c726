"""Limits of a scenario: what a run keeps or breaks.

evaluation  limits by the summary of a run
unjudged    limits over messages that are missing in the log
live_limit  one limit followed through a running simulation
deadlines   what followers have to have done by an instant
"""
