"""The car: its parameters, its motion and its sensors.

parameters       masses, tyres, axles, steering; load; feedback gains
outline          the body on the ground
tyres            slip angles, saturating forces, the share of friction in use
integration      integration shared by both tyre models
brush_motion     the single-track model on saturating tyres: a car that can slide
dynamics         the single-track model with steering actuation, integrated
path_keeping     heading and steering of a car that exactly follows a path
gnss             the GNSS receiver, and its fixes as messages
positioning/     settings of the receiver, errors of its positions
sending/         rules for sending fixes
sensors/         sensors of the own motion and of the gap ahead
clock_error      error of the vehicle's clock
dead_reckoning   prediction of the motion from these sensors, and its error
"""
