"""Recorded drives: CSV, GPX, NMEA 0183 and logs, laid into the plane."""
