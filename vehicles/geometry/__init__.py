"""The earth and the plane, and paths on it.

geodesy             WGS84 against the local east-north plane, compass course against yaw
path_point          a point of a path, and the foot of a point on a path
arc_spline          lines, arcs and clothoids with a continuous tangent
sampled_path        a path that a lead can drive: position, yaw and curvature by arc length
local_regression    local cubics through noisy points, and the cubic through four values
bridges             holes in recorded points, and their noise
smoothing           a path from recorded points
driven_path         the path the lead drove, and the cross-track error from it
lanes               edges of a lane, and paths with fewer points, for pictures
trajectory_points   points along a composite trajectory, for pictures
"""
