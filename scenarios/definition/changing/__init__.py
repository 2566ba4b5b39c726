"""Changes to a running convoy: their effects, and requests by hand.

links  which links and vehicles a change is about, and what a changed link does from when on
asked  one change that is requested by hand, read or refused in a line
"""
