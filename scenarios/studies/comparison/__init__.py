"""Comparisons of runs: their settings, their metrics, and where their vehicles part."""
