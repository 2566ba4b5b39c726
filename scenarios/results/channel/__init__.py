"""Achieved against requested behaviour of the links of a run."""
