"""Commands that drive a convoy.

commands     run, router, vehicle, record
launching    what run does: start the processes of a convoy, or run it virtually
recording    what is done where a run is recorded: listeners, log, summary
destination  where its files go, and its picture
progress     the live table of a run
"""
