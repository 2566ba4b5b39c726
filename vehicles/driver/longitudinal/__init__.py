"""Longitudinal control of a follower: from the motion of other vehicles to an acceleration."""
