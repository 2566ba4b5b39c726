"""Commands that answer from many runs.

blame      which losses of a recorded run were to blame
sweep      many values of some keys, many seeds: tables and heat maps
"""
