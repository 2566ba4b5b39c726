"""What a scenario asks for before it is run, and what deserves a warning.

report        figures of the lead's planned run, and warnings
preview       whether followers receive enough of the path ahead of them
receivers     whether receivers are good enough to follow another car's path by
links         what is asked of each link: rule, laws in words, what follows
alarms        how often a source counts as lost although its sender sends
sample        messages of one link, drawn by the effects of a run
steering      stability of the sampled loop, slip in bends, certificate for changes of speed
"""
