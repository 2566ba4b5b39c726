"""Reactions of followers when all messages stop during a double lane change.

cut          one such run and its figures
campaign     many of them, with each reaction
error_plots  how far they stray, and how far they drive blind
"""
