"""Recorded drives: the lead's trace and replayed followers."""
