"""What happened on the road that must not pass unseen, found message by message.

bodies      the rectangles that cars are: overlap and distance
encounters  gaps, near misses and collisions
watches     stops, and sources that are not believed
detector    all of it: those, lane departures, paths lost, slides, stops
run_event   one of them, as the summary and the log tell it
"""
