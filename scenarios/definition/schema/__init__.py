"""The tables of a scenario file: keys with units, defaults and limits.

table    what they have in common
path     the path: segments, a recorded trace, or points
links    what directed links do to messages
radio    what a link's radio receives over a distance
tables   all others, and the file as a whole
"""
