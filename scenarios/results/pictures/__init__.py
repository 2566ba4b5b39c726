"""The picture of a run, live and from its log, here and in other programs.

run_drawing      the live picture of a run, with its events and gaps
log_drawing      the same from the columns of a log
ordered_figures  true errors and events by their places in a log
lead_in          the true poses that the errors of a part need
layouts          layout of a log for Foxglove
review           opens a log and draws it
"""
