"""Outages of a link, each law the table of a scenario file.

by_time        time windows, of an outage or of a vehicle's radio
by_place       a stretch of the road, a circle in the plane
random_outage  random durations on and off
"""
