"""Several runs in Rerun: one picture over time and distance along their path."""
