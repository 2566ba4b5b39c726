"""One vehicle as a node: the same object on the wall clock and in virtual time.

node       the heart: what happens at one tick
assembly   the parts of a vehicle put together from its scenario
signals    its receiver and its sender
replayed   a vehicle that moves as it was recorded
agenda     what is done to it, and when
changed_links  what is changed of its incoming links
outbox     the messages that it sends
sink       where they go: to the bus, and to whoever records
fault      a vehicle that cannot drive on
probe      memory, processor time and lateness of its process
"""
