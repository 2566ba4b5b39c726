"""The car: what it is made of, how it moves, and how it measures itself.

parameters   masses, tyres, axles, steering; load; feedback gains
dynamics     the single-track model with steering actuation, integrated
gnss         the GNSS receiver, and its fixes as messages and back
imu          gyroscope and wheel speed, or exact knowledge of the car
"""
