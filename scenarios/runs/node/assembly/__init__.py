"""The parts of a vehicle put together from its scenario.

vehicle  the node: its car, its links, and what it does first
drivers  who drives it: its software, or a human
signals  its receiver and its sender
"""
