"""Drivers: the lead steers along its path, followers along the poses they received.

decision        interface of a driver, and its decision at a control instant
ego/            the own state
tracking        errors against the trajectory, and the return to a path received again
steering        from errors to a steering command: the paper's law and others
command_limit   limits of the steering angle and its rate
bends           speed in bends of the known path ahead
longitudinal/   longitudinal control of followers
speed           from gaps and profiles to an acceleration
position_limit  speed limit of a car that is uncertain of its position
instant_draw    random numbers of the classes that decide
reactions       commands without data
degradation/    reactions to missing and to false messages
convoy/         the lead's view of its own convoy: its distance from members, and waiting
leader          the lead, along its own path
follower        a follower: from received poses to steering and speed
"""
