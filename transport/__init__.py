"""Messages and clocks of a run, its log and its picture.

topics           the table of topics
reasons          the table of reasons of unused messages
codec            bytes from messages and back
columns          messages as arrays by field
message_numbers  received numbers of a sender's messages
thinning         thinning of topics in the log
texts            escaping of foreign texts
closing          base class of context managers with `close`
colours          colours of the vehicles in every picture
panels           the table of panels of the picture, live and of a log
clock            wall clock and virtual time
bus/             between processes: Zenoh, or memory within one process
links/           directed links, and the inbox of a vehicle
log/             the MCAP file of a run
picture/         the run in Rerun
"""
