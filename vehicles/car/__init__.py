"""The car: what it is made of, how it moves, and how it measures itself.

parameters       masses, tyres, axles, steering; load; feedback gains
tyres            slip angles, forces that saturate, the share of friction in use
integration      what the motions on both kinds of tyres share
brush_motion     the single-track model on tyres that saturate: a car that can slide
dynamics         the single-track model with steering actuation, integrated
path_keeping     how a car stands and steers that keeps exactly to a path
gnss             the GNSS receiver, and its fixes as messages and back
positioning/     settings of the receiver, errors of its positions
sending/         when a vehicle sends which of its fixes
imu              gyroscope and wheel speed, or exact knowledge of the car
imu_settings     settings of these sensors
clock_error      by how much its clock is off
dead_reckoning   how the car moves on by what these say, and how wrong that becomes
"""
