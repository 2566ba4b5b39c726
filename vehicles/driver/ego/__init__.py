"""What a driver knows of its own car.

own_state        interface of the own pose; exact knowledge of it
pose_estimator   from its sensors: a Kalman filter
late_fixes       the same filter for fixes that arrive late
covariance       covariance of the estimate
slip_estimator   how heavily it is laden, from how it answers its steering
"""
