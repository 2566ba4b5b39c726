"""`convoy bisect`: the value of a key from which on runs break a limit.

curve     how many seeds break the limit at the values that were tried
search    where the share of them crosses the one that is asked for
answer    the question, the jobs and the answer
picture   the share over the value, with its intervals
written   both files
"""
