"""What a driver knows of its own car.

own_state        its state now; exact knowledge
pose_estimator   from its sensors: a Kalman filter
late_fixes       the same where its fixes come late
covariance       how wrong that may be
slip_estimator   how heavily it is laden, from how it answers its steering
"""
