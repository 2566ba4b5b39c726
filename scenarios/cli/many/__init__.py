"""Answers from many runs.

blame   blame: which losses of a recorded run were to blame
"""
