"""The picture of a run in Rerun, live or from its log.

option            the destination of the picture
view              opens and closes the picture
recording_writer  turns messages into entities of the recording
log_writer        the same from the columns of a log
shapes            cars, road, name tags
detail            level of detail of a long convoy
axes              axes of the plots
marks             marks of events in plans and plots
series/           curves, states and trajectories
blueprint         layout and colours
comparison/       several runs in one picture
viewer_process    Rerun's own programs as processes
"""
