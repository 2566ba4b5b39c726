"""One vehicle as a node: the same object on the wall clock and in virtual time.

node       what happens at one tick
phases     the heart: its software drives, or stalls, or is down, or a human drives
changes    carries out what is done to it
assembly   the parts of a vehicle put together from its scenario
signals    its receiver and its sender
replayed   a vehicle that moves as it was recorded
<<<<<<< HEAD
agenda     what is done to it, and when
changed_links  what is changed of its incoming links
=======
agenda     what is to be done to it, and when
>>>>>>> faults/d_faults
outbox     the messages that it sends
sink       where they go: to the bus, and to whoever records
fault      a vehicle that cannot drive on
probe      memory, processor time and lateness of its process
"""
