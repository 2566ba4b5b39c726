"""Limits of a scenario: what a run keeps or breaks."""
