"""Curves, states and trajectories of the picture.

curves           curves and states over time, by the table of panels, message by message
link_states      states of each link over half seconds
log_series       the same curves and states from the columns of a log
trajectory_rows  points along many trajectories
moving_rows      positions of the cars and of the view, sent as columns
"""
