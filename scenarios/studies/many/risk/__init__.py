"""`convoy risk`: how probable it is that one run breaks a limit.

splitting  adaptive multilevel splitting, of any paths that can be branched
branched   runs as such paths
estimated  the probability with its interval, by counting or by splitting
written    the machine-readable twin
"""
