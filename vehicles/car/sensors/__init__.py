"""Sensors of the own motion and of the gap ahead.

imu           gyroscope and wheel speed, or the exact state of the car
imu_settings  settings of these sensors
gap_sensor    gap to the predecessor and its rate, as from a radar
"""
