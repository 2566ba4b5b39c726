"""Commands that drive a convoy.

commands        run, router, vehicle, record
replay_command  convoy replay
launching       convoy run, for both clocks
wall_clock_run  a run on the wall clock: its processes are prepared and started
virtual_run     a run in virtual time
recorder_run    convoy record
display         display of a run during recording and at its end
destination     checks of the destination of its picture
progress        the live table of a run
"""
