"""What is wrong with the positions of a receiver beside white noise.

drift         errors that wander: the same path for whoever looks, at any rate
fix_states    how a receiver knows its place from time to time, and where it is blind
gnss_errors   all of it together
"""
