"""What a follower does about messages that do not come, or that cannot be true.

settings    thresholds, braking, and which reaction is asked for
situation   how fresh what a follower knows is, in seconds and metres
reception   what came of a source of late: its period, its share, its silence
trust/      whether what a source says can be true
probation   how long a source that came back has to behave
sources     one source: its trace, its status, its weight
pair        lead and predecessor together
meant_path  the lead's path, by how far off it the predecessor says it is
machine     the mode: whom it steers along, when it slows down and stops
baselines   what others do that do not degrade
rejoining   back to a path that is heard of again
slowing/    how fast to go
"""
