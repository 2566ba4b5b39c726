"""Changes to a running convoy: their effects, and requests by hand.

vehicle_changes  changes that contradict the vehicles, the run or one another
links  which links and vehicles a change is about, and what a changed link does from when on
asked  one change that is requested by hand, read or refused in a line
"""
