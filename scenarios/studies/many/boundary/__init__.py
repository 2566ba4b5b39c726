"""`convoy bisect`: the value of a key from which on runs break a limit.

curve            share of broken runs over the value, and bisection of it
boundary_search  the query, its jobs and the result
boundary_files   JSON and the plot of the share over the value
"""
