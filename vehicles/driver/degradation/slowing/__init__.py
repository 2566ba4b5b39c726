"""How fast to go while messages fail.

stopping      braking distances, and how hard to brake for a distance
lateness      how much later than usual a vehicle is heard
announced     a predecessor that has announced when it will stop
longitudinal  the speed of a follower: braking, wider gaps, safe distances, catching up
waiting       a lead that waits for followers that are lost
"""
