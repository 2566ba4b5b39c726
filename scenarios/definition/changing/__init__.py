"""Changes to a running convoy: what they come to, and how they are asked for by hand.

links     what a changed link does from when on, and what does not fit
concerned  which vehicle carries out a change
asked     one change that is asked for by hand, read or refused in a line
"""
