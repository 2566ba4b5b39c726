"""Commands that answer from many runs.

drill      failure drills: what must hold, and whether it does
worst      the instant at which a burst does most harm
sweep      many values of some keys, many seeds: tables and heat maps
blame      which losses of a recorded run were to blame
"""
