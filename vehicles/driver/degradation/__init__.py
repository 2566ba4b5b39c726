"""Reactions of a follower to missing and to false messages.

settings         thresholds, braking, and the configured reaction
situation        freshness of the sources, in seconds and metres
innovation       distance of a pose from its prediction by earlier poses of its source
innovation_gate  plausibility of a pose by its innovations
trust            use or refusal of received poses, by gate and reachability
reception        statistics of one source's messages: period, share, age, probation
source           one source: its trace, its status, its weight
sources          all sources together, and their weights
intended_path    the lead's path, from the offset that the predecessor announces
modes            the mode: sources to steer along, slowing down, stopping
stopping         braking distances, and announced stops
speed_guard      the speed of a follower while messages fail
"""
