"""The picture of a run, live and from its log, here and in other programs.

run_drawing  the picture of a run, with its events and gaps
layouts      layouts of a log for Foxglove and Rerun
review       the picture of a log
"""
