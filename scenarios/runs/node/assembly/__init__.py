"""The parts of a vehicle put together from its scenario.

vehicle_builder      the node: its car, its links, and what it does first
driver_builder       its driver: software or a human
receiver_and_sender  its receiver and its sender
"""
