"""One vehicle as a node: the same object on the wall clock and in virtual time.

node           what happens at one tick
phases         the heart: its software drives, or stalls, or is down, or a human drives
agenda         what is to be done to it, and when
changes        carries that out
changed_links  what of it is done to its incoming links
assembly/      the parts of a vehicle put together from its scenario
replayed       a vehicle that moves as it was recorded
outbox         the messages that it sends
sink           where they go: to the bus, and to whoever records
fault          a vehicle that cannot drive on
probe          memory, processor time and lateness of a vehicle
process_probe  those of its process
"""
