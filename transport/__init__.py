"""What carries messages and time, and shows them.

topics           the table of topics: name, message, how urgent, whether it may wait
reasons          the table of reasons why a message was not used
codec            bytes from messages and back
message_numbers  which of a sender's messages came
telemetry        messages that only the log needs, many in one
thinning         of which topics the log holds but some messages
texts            what of a text may reach a terminal and a line of the log
closing          what closes itself at the end of a `with`
colours          colours of the vehicles in every picture
panels           the table of panels of the picture, live and of a log
clock            wall clock and virtual time
bus/             between processes: Zenoh, or memory within one process
links/           what a directed link does to a message, and what a vehicle receives
log/             the MCAP file of a run
picture/         the run in Rerun
"""
