"""Longitudinal control of a follower: from the motion of other vehicles to an acceleration.

spacing      spacing to keep, and limits of the acceleration
controller   interface of a controller, and its inputs
gap_keeping  the law of the shipped controller
own_path     the path driven, for vehicles behind
laws         shipped controllers
"""
