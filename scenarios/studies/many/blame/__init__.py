"""`convoy blame`: the losses that caused the worst figure of a recorded run.

losses         losses in the log: bursts, and bursts that overlap in time
listed_losses  the recorded scenario with exactly the losses of a list
rerun          one run with other losses: its worst figure, and whether it breaks a limit
trials         parallel reruns without repetitions
ranking        bursts by their effect in metres, by bisection
shrinking      the smallest set of losses that still breaks the limit, by delta debugging
study          all steps in order
blame_files    JSON, the plot, and the scenario of the smallest set
"""
