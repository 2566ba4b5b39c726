"""What a scenario asks for before it is run, and what deserves a warning.

report        figures of the lead's planned run, and warnings
preview       whether followers receive enough of the path ahead of them
receivers     whether receivers are good enough to follow another car's path by
links         what is asked of each link: rule, laws in words, what follows
alarms        how often a source counts as lost although its sender sends
sample        messages of one link, drawn by the effects of a run
sampled_loop  whether cars know themselves and decide often enough for their speed
slip          what the paper's law leaves in bends although a load is learned
certificate   whether changes of speed stay within what the gains are certified for
"""
