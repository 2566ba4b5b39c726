"""`convoy bisect`: the value of a key from which on runs break a limit.

curve            share of seeds that break the limit at each value, and where it crosses
boundary_search  the query, its jobs and the result
boundary_files   the share over the value as a picture and as JSON
"""
