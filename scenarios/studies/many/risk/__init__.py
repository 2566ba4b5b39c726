"""`convoy risk`: how probable it is that one run breaks a limit.

splitting  adaptive multilevel splitting, of any paths that can be branched, and of runs
estimated  the question, the probability with its interval by counting or splitting, its file
"""
