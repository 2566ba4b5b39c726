"""Figures and warnings of a scenario before it runs."""
