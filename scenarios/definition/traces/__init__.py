"""Recorded drives for the lead, which a scenario names as a trace.

formats    CSV, GPX, NMEA 0183 and logs: points as the file holds them, and its bad lines
cleaning   jumps of a receiver, and its wander while it stands
recorded   read, checked, laid into the plane, and put into the scenario
"""
