"""Runs whose probability to break a limit is known."""
