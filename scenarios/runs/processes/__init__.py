"""The processes of a run on the wall clock.

launcher          `convoy run`: starts router, recorder and vehicles, in this order
supervisor        starts, watches and stops child processes
forking           a child forked from this process, ready in milliseconds
router            the Zenoh router
recorder_process  the recorder: gathers the convoy, writes the log, ends the run
arrivals          messages that wait for the recorder
conductor         decides when the run starts and ends
router_watch      how long the router has been out of reach
membership        members of a run: unique names, equal scenario, seed and version
clock_sync        keeps the vehicles' clocks on the recorder's
vehicle_process   one vehicle
restart           restarts the process of a vehicle after a requested crash
"""
