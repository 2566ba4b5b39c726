"""Detection of events on the road.

bodies      cars as rectangles: overlap and distance
encounters  gaps, near misses and collisions
lane        departures from the lane
watches     lost paths, slides, stops, and distrusted sources
own_measures  events and figures of the user's classes
run_event   events as the summary and the log list them
"""
