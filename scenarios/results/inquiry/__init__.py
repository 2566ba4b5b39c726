"""Questions put to a recorded run.

explain   what a vehicle knew at an instant, and why no more
"""
