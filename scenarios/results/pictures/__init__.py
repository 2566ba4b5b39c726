"""The picture of a run, live and from its log, here and in other programs.

run_drawing  the picture of a run, with its events and gaps
layouts      what other programs need to show a log
review       the picture of a log
"""
