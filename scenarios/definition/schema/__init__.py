"""The tables of a scenario file: keys with units, defaults and limits.

table        what they have in common
settings     tables made from the settings classes of vehicles
path         the path: segments, a recorded trace, or points
gnss         the receivers and the errors of their positions
links        what directed links do to messages
changes      what is done to a running convoy
limit_rows   the table of limits
limits       what a run has to hold
log          what the log of a run holds
tables       all others, and the file as a whole
"""
