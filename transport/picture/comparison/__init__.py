"""Several runs in Rerun: one picture over time and distance along their path.

tracks   the vehicles of all runs as arrays
layout   layout of the picture
drawing  draws the tracks
"""
