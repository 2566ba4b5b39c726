"""Commands for a convoy that drives: change it, look at it, and make a scenario of what was done.

commands   link, cut, heal, gnss, stall, kill, speed, status, scenario-from
options    what they have in common: which run, for how long
asking     which run is meant, and what its vehicles say to a change
shown      how it goes, as a table
"""
