"""All vehicles of a scenario in one process, as fast as possible.

drive       the harness: a run whose messages go to observers
convoy      the vehicles, their bus, their clock and the order of their steps
replay      a recorded vehicle that sends its poses again
logged      a run with log and summary
unlogged    a run with only its summary, or its drives
"""
