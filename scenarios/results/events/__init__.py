"""Events on the road, found message by message.

bodies      the rectangles that cars are: overlap and distance
encounters  gaps, near misses and collisions
lane        departures from the lane
watches     paths lost, slides, stops, and sources that are distrusted
run_event   events as the summary and the log list them
"""
