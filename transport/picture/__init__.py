"""The picture of a run in Rerun, live or from its log.

option           the value of `--rerun`: where the picture goes
view             opens and closes it there
picture          turns messages into entities of the recording
shapes           cars, road, name tags
detail           how much is drawn of a long convoy
curves           curves and states over time, as the table of panels lists them
marks            marks of collisions and the like, in plans and plots
link_states      how each link was over each half second
blueprint        layout and colours
log_layout       layout for a log that Rerun opens by itself
viewer_process   Rerun's own programs beside us
"""
