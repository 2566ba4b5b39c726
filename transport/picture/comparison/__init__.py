"""The picture of several runs in Rerun, over time and over the distance along their path.

tracks   the vehicles of all runs as arrays
layout   layout of the picture
drawing  draws the tracks
"""
