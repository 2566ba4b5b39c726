"""Received positions of each source, and the path that they make known."""
