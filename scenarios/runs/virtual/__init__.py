"""All vehicles of a scenario in one process, as fast as possible.

drive             the harness: a run whose messages go to observers
virtual_convoy    the vehicles, their bus, their clock and the order of their steps
logged_run        a run with log and summary
unlogged_run      a run with only its summary, or its drives
"""
