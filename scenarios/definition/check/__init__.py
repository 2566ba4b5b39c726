"""What a scenario asks for before it is run, and what deserves a warning.

report        `convoy check`: figures of the lead's planned run, and all warnings but the last one's
preview       whether followers receive enough of the path ahead of them
certificate   whether changes of speed stay within what the gains are certified for; loads scipy
"""
