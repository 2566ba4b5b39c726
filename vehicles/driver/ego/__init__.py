"""State estimation of the own car.

own_state        interface of the own pose, and the exact state
pose_estimator   Kalman filter of the own sensors
late_fixes       the same filter for fixes that arrive late
covariance       covariance of the estimate
slip_estimator   load of the car, from its response to steering
"""
