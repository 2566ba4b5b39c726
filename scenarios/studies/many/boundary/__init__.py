"""`convoy bisect`: the value of a key from which on a share of the runs breaks a limit.

curve             an S-shaped curve of shares over the value, with the posterior of its boundary
boundary_search   the query, its runs and the result
boundary_picture  the plot of the shares over the value
boundary_files    the search with its files
"""
