"""All vehicles of a scenario in one process, as fast as it goes.

drive       the harness: a run whose messages go to observers
convoy      the vehicles, their bus and their clock
step_order  the order of the vehicles' steps
replay      a recorded vehicle that sends its poses again
logged      a run with log and summary
unlogged    a run with only its summary, or its drives
"""
