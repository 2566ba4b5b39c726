"""Figures of single vehicles.

vehicle_figures  a vehicle's figures, as they are gathered and as the summary lists them
reaction         what one follower did when messages failed
accumulators     running extremes and means of signals
string_norms     norms of lateral errors, spacing errors and accelerations
string_figures   gains from vehicle to vehicle, and from head to tail
string_errors    both as a table
"""
