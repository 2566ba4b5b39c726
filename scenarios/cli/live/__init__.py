"""Commands for a convoy that drives: change it, look at it, and make a scenario of what was done.

commands  link, cut, heal, gnss, stall, kill, speed, status, scenario-from
asking    the requested run, and the answers of its vehicles to a change
shown     the status of a run as tables
"""
