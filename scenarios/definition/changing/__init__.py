"""Changes to a running convoy: their effects, and requests by hand.

vehicle_changes  changes that contradict the vehicles, the run or one another
link_changes     changes of links: the links concerned, and their effects over time
live_change      one change requested while the convoy runs
"""
