"""Commands that simulate many runs.

study_options  options that these commands share
drill          failure drills: scenarios with limits
sweep          values of some keys and seeds: tables and a picture
bisect         the value of a key at which runs begin to break a limit
blame          the losses of a recorded run that caused its error
"""
