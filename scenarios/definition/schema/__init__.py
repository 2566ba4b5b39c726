"""The tables of a scenario file: keys with units, defaults and limits.

table    what they have in common
path     the path: segments, a recorded trace, or points
links    what directed links do to messages
delay    their laws of delay, and their queue
outages  when and where they carry nothing
tables   all others, and the file as a whole
"""
