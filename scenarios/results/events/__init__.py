"""Detection of events on the road."""
