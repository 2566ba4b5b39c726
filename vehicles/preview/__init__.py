"""From received poses to the composite trajectory.

samples       one received pose, the window around the ego, constants
polyline      points in order of travel with their arc length
trace         what was received of one source, in order of travel
trajectory    the composite trajectory of both sources
curve_fit     which curves explain the samples, and their mean
fit_arc       least squares for a line and an arc, and what all shapes share
fit_clothoid  least squares for a curve whose curvature changes evenly
fit_joined    least squares for two of line and arc with one tangent where they join
laying        the mean of two curves, and a curve laid in the world
paper_recipe  the paper's own trajectory: line test, then line or circle
outliers      samples that have jumped
"""
