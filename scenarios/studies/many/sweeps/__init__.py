"""`convoy sweep`: one scenario with many values of some keys, and many seeds."""
