"""Limits of a scenario: what a run keeps or breaks.

judged      limits by the summary of a run
live        one limit followed through a running simulation
deadlines   what followers have to have done by an instant
"""
