"""A log that another process writes.

writer  what a run calls, and sends its messages by
server  the other process, which writes the file
"""
