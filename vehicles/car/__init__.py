"""The car: its parameters, its motion and its sensors.

parameters       masses, tyres, axles, steering; load; feedback gains
tyres            slip angles, forces that saturate, the share of friction in use
integration      common part of both integrations
brush_motion     the single-track model on tyres that saturate: a car that can slide
dynamics         the single-track model with steering actuation, integrated
path_keeping     heading and steering of a car that keeps exactly to a path
gnss             the GNSS receiver, and its fixes as messages
positioning/     settings of the receiver, errors of its positions
sending/         rules of sending fixes
imu              gyroscope and wheel speed, or exact knowledge of the car
imu_settings     settings of these sensors
clock_error      error of the vehicle's clock
dead_reckoning   prediction of the motion by these sensors, and its error
"""
