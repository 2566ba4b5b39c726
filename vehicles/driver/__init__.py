"""What decides: the lead along its path, followers along what they received.

decision         what a driver is and what it decides at a control instant
own_state        what is known of the own car; exact knowledge
pose_estimator   where the car is now, from its sensors: a Kalman filter
late_fixes       the same where its fixes come late
covariance       how wrong that may be
tracking         errors against the trajectory
steering         from errors to a steering command: the paper's law and others
command_limit    no command that the wheels cannot follow
speed            from gaps and profiles to an acceleration
slip_estimator   how heavily the car is laden, from how it answers its steering
leader           the lead
follower         a follower: what it knows of lead and predecessor, and what it makes of it
"""
