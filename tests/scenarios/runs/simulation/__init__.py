"""Simulation of the protocol of a run: its real loops on a virtual clock, with faults from a seed.

plan        a run and its faults, drawn from a seed
scheduler   roles on threads of their own, one at a time, and the clocks of hosts
network     a bus whose sessions are cut off, expire and return as those of Zenoh
disk        a folder that fails at the n-th write and survives kills
world       one run with its processes and faults
invariants  what must hold after every run
states      what a run reached
planted     bugs that the simulation has to find
shrinking   simulates plans and reduces those that break an invariant
"""
