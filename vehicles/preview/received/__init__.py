"""Received positions of each source, and the path that they make known.

samples     the window of samples around the ego, and reachability checks
polyline    points in order of travel with their arc length
holes       stretches without positions: bridged, or closed by path histories
trace       received samples of one source, in order of travel
known_path  the path ahead that samples of both sources cover
"""
