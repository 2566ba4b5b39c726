"""Geodesy, and paths in the plane.

geodesy             WGS84 to and from the local east-north plane, compass course to and from yaw
path_point          a point of a path, and the projection of a point on a path
arc_spline          lines, arcs and clothoids with a continuous tangent
sampled_path        a path that a lead can drive: position, yaw and curvature by arc length
path_offsets        offsets of many points from a path
local_regression    local cubics through noisy points, and the cubic through four values
sparse_path         a path through the few positions of a path history
bridges             holes in recorded points, and the noise of the points
smoothing           a path from recorded points
driven_path         the path driven by the lead, and the cross-track error from it
lanes               edges of a lane, and simplified paths, for pictures
trajectory_points   points along a composite trajectory, for pictures
"""
