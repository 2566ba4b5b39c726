"""From received poses to the composite trajectory.

received/     received positions of each source, and the known path
trajectory    the composite trajectory of both sources
source_window  the samples of one source with their weight
fusion        trajectories from the sources, and their shares
curve_fit     the curves that explain the samples, and their average
fit_arc       least squares for a line and an arc, and the sums that all shapes share
fit_clothoid  least squares for a curve with linearly changing curvature
fit_joined    least squares for two pieces with a common tangent at the join
local_curves  averaging two curves, and placing a curve in the world
paper_recipe  the paper's own trajectory: line test, then line or circle
outliers      samples that jumped
"""
