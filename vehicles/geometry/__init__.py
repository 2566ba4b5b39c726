"""The earth and the plane, arc splines, paths, and how far beside a path something is."""
