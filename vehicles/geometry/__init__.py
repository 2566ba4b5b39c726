"""Geodesy, and paths in the plane."""
