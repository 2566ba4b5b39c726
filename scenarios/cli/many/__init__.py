"""Commands of many runs.

sweep      many values of some keys, many seeds: tables and heat maps
"""
