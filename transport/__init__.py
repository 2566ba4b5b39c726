"""What carries messages and time, and shows them.

topics, codec        which messages there are, and their bytes
clock                wall clock and virtual time
bus/                 between processes: Zenoh, or memory within one process
links/               what a directed link does to a message, and what a vehicle receives
log/                 the MCAP file of a run
picture/             the run in Rerun
"""
