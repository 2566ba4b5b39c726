"""Laws of when and where a link carries nothing, each a class that is the table of a scenario file.

span    times: of an outage, or in which the radio of a vehicle is off
placed  a stretch of the road, a circle in the plane
random  by chance
"""
