"""Commands that make many runs.

drill   failure drills: what must hold, and whether it does
worst   the instant at which a burst does most harm
"""
