"""State estimation of the own car.

own_state         interface of the own pose, and the exact state
pose_estimator    Kalman filter of the own sensors
late_fixes        the same filter for fixes that arrive late
own_track         one estimate and its corrections
covariance        covariance of the estimate while errors of fixes are white
joint_covariance  covariance of the estimate and of lasting errors of fixes
slip_estimator    load of the car, from its response to steering
"""
