"""What a vehicle is and decides: pure functions of state, time and messages; no input or output.

messages, schedule   what vehicles say, and the instants at which they act
geometry/            the earth and the plane, arc splines, paths, the cross-track error
car/                 the car: parameters, motion, GNSS receiver
preview/             from received poses to the composite trajectory
driver/              from the trajectory to steering and speed: lead and follower
theory/              the same loop as linear algebra: stability, gain sets, string stability
"""
