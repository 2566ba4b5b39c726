"""Recorded drives: the lead's trace and replayed followers.

formats           from the bytes of a file to columns of points
recorded_drive    those columns, and the list of records left out
positions         positions without a fix, off the earth, and far away
time_order        times that never run back
disorder          records out of order, of a wrong time, or after a leap of the clock
holds             repeated positions of a sampling slower than the file
receiver_errors   outliers, and standstills that drift
cleaning          remove both
recorded_speeds   usable recorded speeds
vertices          drawn lines, whose points are far apart
part              the part that is driven
pauses            times without progress in it
reading           read a drive through these stages, and project it into the plane
scenario_drives   put drives into a scenario
"""
