"""What a follower does about messages that do not come, or that cannot be true.

settings    thresholds, braking, and which reaction is asked for
situation   how fresh what a follower knows is, in seconds and metres; what it tells those behind
innovation  how far a pose lies from where earlier ones of its source say it should be
trust       the gate for a source: which poses to believe, and why not
beliefs     all gates of a follower, and what it says of sources that it does not believe
"""
