"""Comparisons of runs: `convoy diff`.

run_diff       what differs between two runs or two groups of runs
settings_diff  settings that differ
message_diff   the first differing message
figure_diff    figures, and the noise over seeds
"""
