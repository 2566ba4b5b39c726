"""Comparisons of runs: `convoy diff` and `convoy compare`."""
