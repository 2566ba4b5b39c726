"""Commands that answer from many runs.

options    options that these commands share
drill      failure drills: what must hold, and whether it does
worst      the instant at which a burst does most harm
sweep      many values of some keys, many seeds: tables and heat maps
bisect     from which value of a key on a limit is broken
risk       how probable it is that one run breaks a limit
blame      which losses of a recorded run were to blame
"""
