"""Commands that drive a convoy.

commands     run, router, vehicle, record
launching    convoy run, for both clocks
processes    a run on the wall clock: its processes are prepared and started
virtually    a run in virtual time
recording    convoy record
watching     display of a run during recording and at its end
destination  folder of its files, destination of its picture
progress     the live table of a run
"""
