"""What the convoy drives.

route        the lead's path, the gaps at the start, and the lead's speed
replayed     the motion of a vehicle that is replayed
lead_speed   that speed: lowered before curves, or as recorded
set_speed    that speed when it is changed, and that of a car that sets off
"""
