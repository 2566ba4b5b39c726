"""Vehicles and their decisions: pure functions of state, time and messages.

messages       messages of vehicles: poses for the convoy, everything else for the log
setting        unit and bounds of a setting's key, next to its field
schedule       instants in nanoseconds, periodic schedules, timers
geometry/      geodesy, arc splines, sampled paths, the cross-track error
received_pose  a pose as its receiver uses it
car/           the car: parameters and load, motion, GNSS receiver, inertial sensor
preview/       from received poses to the composite trajectory
driver/        from the trajectory to steering and speed: what a follower estimates and decides
theory/        the same loop as linear algebra: stability, gain sets, string stability
"""
