"""What a run was, live, in virtual time or from its log.

metrics       figures gathered message by message
bodies        the rectangles that cars are: overlap and distance
encounters    gaps, near misses and collisions
events        all that must not pass unseen: those, lane departures, paths lost
limits        which limits of the scenario were broken
holes         what was not recorded
summary       the typed summary, and its JSON
log_summary   summary and scenario from a log alone
drives        what each vehicle drove, as arrays
review        the picture of a log
"""
