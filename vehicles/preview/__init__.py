"""From received poses to the composite trajectory.

samples       one received pose, the window around the ego, constants
polyline      points in order of travel with their arc length
trace         what was received of one source, in order of travel
trajectory    the composite trajectory of both sources
curve_fit     which curve explains the samples
fit_arc       least squares for a line and an arc
fit_joined    least squares for a line and an arc with one tangent where they join
paper_recipe  the paper's own trajectory: line test, then line or circle
outliers      samples that have jumped
"""
