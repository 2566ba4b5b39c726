"""What a follower does about messages that do not come, or cannot be true.

settings         thresholds, braking, and which reaction is configured
situation        how fresh what a follower knows is, in seconds and metres
innovation       how far a pose lies from where earlier poses of its source predict it
innovation_gate  whether a car can have come to a pose from its source's earlier ones
trust            the one judge of received poses, by gate and reach
reception        how a source is received: period, share, age, probation
source           one source: its trace, its status, its weight
sources          lead and predecessor together
meant_path       the lead's path, by the offset from it that the predecessor announces
modes            the mode: which sources it steers along, when it slows down and stops
stopping         braking distances, and stops that were announced
speed_guard      the speed of a follower while messages fail
"""
