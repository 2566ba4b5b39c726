"""The lead's path and speed, and recorded motions of followers.

route            the lead's path, the gaps at the start, and the lead's speed
point_path       the path through recorded points
usable_width     the half width at which they are smoothed
recorded_place   places of points in their file
pieces           the pieces of a drive that a car can drive forwards
spacing          gaps between bumpers and spacings between centres of mass
replayed_drive   the motion of a replayed vehicle
lead_speed       the lead's speed: lowered before curves, or as recorded
silences         silences of a record, and stops in them
set_speed        the lead's speed after a change, and the speed of a car that sets off
"""
