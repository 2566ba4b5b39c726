"""Recorded drives, which a scenario names: the lead's trace, a follower's replay.

formats    CSV, GPX, NMEA 0183 and logs: points as the file holds them, and its bad lines
jumps      of a receiver
stands     of a car, while its receiver wanders
cleaning   a drive without either, and without leaps of its clock
recorded   read, checked, laid into the plane
placed     put into the scenario
"""
