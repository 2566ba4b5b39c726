"""Whether what a source says can be true.

innovation  how far a pose lies from where earlier ones of its source say it should be
gate        the gate for a source: which poses to believe, and why not
beliefs     all gates of a follower, and what it says of sources that it does not believe
"""
