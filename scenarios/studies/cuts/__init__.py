"""What followers do when all messages stop at some instant of a double lane change.

cut        one such run and its figures
campaign   many of them, with each reaction
picture    how far they stray, and how far they drive blind
"""
