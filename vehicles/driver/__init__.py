"""What decides: the lead along its path, followers along what they received.

decision        what a driver is and what it decides at a control instant
ego/            what is known of the own car
tracking        errors against the trajectory, and the return to one that was lost
steering        from errors to a steering command: the paper's law and others
command_limit   no command that the wheels cannot follow
speed           from gaps and profiles to an acceleration
degradation/    what a follower does about messages that do not come, or cannot be true
leader          the lead, and its wait for lost followers
follower        a follower: from received poses to steering and speed
"""
