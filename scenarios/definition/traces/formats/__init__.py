"""Formats of recorded drives: from the bytes of a file to columns of points."""
