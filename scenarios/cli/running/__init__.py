"""Commands that drive a convoy.

commands     run, router, vehicle, record
launching    what run does, whichever clock it has
processes    a run on the wall clock: its processes are prepared and started
virtually    a run in virtual time
recording    what record does
watching     what is shown of a run, while it is recorded and when it is over
destination  where its files go, and its picture
progress     the live table of a run
"""
