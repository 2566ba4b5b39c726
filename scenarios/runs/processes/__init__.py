"""The processes of a run on the wall clock.

launcher       `convoy run`: starts the router, the recorder and the vehicles, in this order
supervisor     starts processes, sees them end, leaves none behind
forking        a process forked from this one, ready in milliseconds
router         the Zenoh router
recording      the recorder: gathers the convoy, writes the log, ends the run
arrivals       what waits for the recorder
conductor      when the run starts and when it is over
router_watch   how long the router has been out of reach
membership     who takes part in a run: once each, and with the same scenario, seed and version
clock_offset   how far the vehicles' clocks are from the recorder's
vehicle        one vehicle
restart        a vehicle that crashes as asked, and starts anew in the same place
"""
