"""Curves, states and trajectories of the picture."""
