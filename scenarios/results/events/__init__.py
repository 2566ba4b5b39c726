"""Detection of events on the road.

bodies      cars as rectangles: overlap and distance
encounters  gaps, near misses and collisions
lane        departures from the lane
watches     lost paths, slides, stops, and distrusted sources
run_event   events as the summary and the log list them
"""
