"""Reactions of followers to a cut of all links during a double lane change.

cut          one run with a cut, and its figures
campaign     random cuts, simulated with each reaction
error_plots  errors, and distances driven blind
"""
