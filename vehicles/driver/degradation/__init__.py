"""What a follower does about messages that do not come, or that cannot be true.

lateness      how much later than usual a vehicle is heard
longitudinal  the speed while messages fail: braking, wider gaps, safe distances, catching up
settings      thresholds, braking, and which reaction is asked for
stopping      braking distances, and how hard to brake for a distance
situation     how fresh what a follower knows is, in seconds and metres; what it tells those behind
waiting       a lead that waits for followers that are lost
"""
