"""The MCAP log of a run, written as it happens and read back."""
