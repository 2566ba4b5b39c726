"""The lead's view of its own convoy, from the poses of its followers.

stations   where on the lead's path a follower is
watch      whether the lead waits for lost followers
lane       the strip that a car sweeps along its path, and what reaches into it
reserved   parts of the path that the last follower has yet to drive, and that cross the path ahead
ahead      the lead's distance from members of its convoy ahead of it on its path
"""
