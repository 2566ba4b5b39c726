"""Figures of single vehicles.

vehicle_figures  a vehicle's figures, as they are gathered and as the summary lists them
reaction         what one follower did when messages failed
accumulators     running extremes and means of signals
string_errors    errors along the string
"""
