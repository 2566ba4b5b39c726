"""From received poses to the composite trajectory.

samples       the window of samples around the ego, constants, how far a car can come
polyline      points in order of travel with their arc length
trace         received samples of one source, in order of travel
trajectory    the composite trajectory of both sources
curve_fit     the curves that explain the samples, and their mean
fit_arc       least squares for a line and an arc, and the sums that all shapes share
fit_clothoid  least squares for a curve whose curvature changes evenly
fit_joined    least squares for two of line and arc with one tangent where they join
local_curves        the mean of two curves, and a curve placed in the world
paper_recipe  the paper's own trajectory: line test, then line or circle
outliers      samples that have jumped
"""
