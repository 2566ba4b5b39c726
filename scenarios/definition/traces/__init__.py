"""Recorded drives: the lead's trace and replayed followers.

formats          formats of files
old_formats      CSV, GPX, NMEA 0183 and logs, until formats replaces it
recorded_drive   columns of points, and the records left out
positions        positions off the earth, without a fix, or far away
time_order       times that never run back
disorder         records out of order, of a wrong time, or after a leap of the clock
holds            positions that a recorder repeats
jumps            outliers of a receiver
stands           standstills with a drifting receiver
cleaning         remove both, and leaps of the clock
reading          read a drive, check it, project it into the plane
scenario_drives  put drives into a scenario
"""
