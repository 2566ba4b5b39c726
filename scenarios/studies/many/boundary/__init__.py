"""`convoy bisect`: the value of a key from which on runs break a limit.

curve   how many seeds break the limit at the values tried, and where their share crosses
answer  the query, its jobs and the answer
report  files: the share over the value as a picture, JSON
"""
