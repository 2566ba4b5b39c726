"""Formats of recorded drives: from the bytes of a file to columns of points.

time_cells  times of a table: dates, times of day, numbers
"""
