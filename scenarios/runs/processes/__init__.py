"""The processes of a run on the wall clock."""
