"""The processes of a run on the wall clock, and what keeps them together."""
