"""The earth and the plane, arc splines, paths, and the cross-track error."""
