"""What a vehicle is and decides: pure functions of state, time and messages.

messages       what vehicles send: poses for the convoy, everything else for the log
setting        unit and bounds of a setting's key, beside its field
schedule       instants in nanoseconds, periodic schedules, what is due
geometry/      the earth and the plane, arc splines, paths, the cross-track error
received_pose  a pose as its receiver uses it
car/           the car: parameters and load, motion, GNSS receiver
preview/       from received poses to the composite trajectory
driver/        from the trajectory to steering and speed: what a follower knows and decides
theory/        the same loop as linear algebra: stability, gain sets, string stability
"""
