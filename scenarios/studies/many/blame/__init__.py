"""`convoy blame`: the losses that caused the worst figure of a recorded run.

losses         bursts of losses in the log, and those that overlap in time
listed_losses  the recorded scenario with exactly the losses of a list
rerun          one run with other losses: its worst figure, and whether it breaks a limit
trials         reruns in parallel, none repeated
ranking        bursts by the metres that they cost, by bisection
shrinking      the smallest set of losses that still breaks the limit, by delta debugging
study          the whole study in order
blame_files    the picture, JSON and the scenario of the smallest set
"""
