"""Each claim of the paper, and what we get."""
