"""All vehicles of a scenario in one process, as fast as it goes.

convoy      the vehicles, their bus and their clock
step_order  whose turn it is
replay      a recorded vehicle put back on the road
logged      a run into a log
aside       a process that writes the log meanwhile
rehearsal   a run whose drives stay in memory
unlogged    a run of which only the figures stay
"""
