"""One vehicle as a node: the same object on the wall clock and in virtual time.

node             one tick of a vehicle, and faults that end it
phases           driving, stalled, restarting, or driven by a human
pending_changes  pending changes of a vehicle
change_executor  carries out changes of a vehicle
changed_links    carries out changes of its incoming links
assembly/        builds the parts of a vehicle from its scenario
replayed_node    a vehicle that repeats a recorded drive
recorded_node    a vehicle that sends recorded messages
recorded_vehicle  the messages of a vehicle in a log
outbox           builds the messages that it sends
sink             publishes them on the bus
probe            memory, processor time and lateness of a vehicle
process_probe    the same of its process
"""
