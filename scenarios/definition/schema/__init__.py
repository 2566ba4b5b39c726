"""The tables of a scenario file: keys with units, defaults and limits.

table    what they have in common
path     the path: segments, a recorded trace, or points
gnss     the receivers and the errors of their positions
sending  when a vehicle sends which of its fixes
loss     laws of loss of a directed link
links    what directed links do to messages
content  what they do to the content and the number of messages
delay    their laws of delay, and their queue
outages  when and where they carry nothing
radio    what a link's radio receives over a distance
tables   all others, and the file as a whole
"""
