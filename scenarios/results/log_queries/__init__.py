"""Analyses of a recorded run."""
