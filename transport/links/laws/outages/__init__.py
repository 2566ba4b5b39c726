"""Laws of when and where a link carries nothing, each a class that is the table of a scenario file.

span     what they have in common; times at which a vehicle's radio is off
window   a time
stretch  a stretch of the road
circle   a circle in the plane
random   by chance
"""
