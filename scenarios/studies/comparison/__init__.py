"""Comparisons of runs: `convoy diff`, `convoy compare` and `convoy recompute`.

run_diff            what differs between two runs or two groups of runs
settings_diff       settings that differ
message_diff        the first differing message
figure_diff         figures, and the noise over seeds
run_comparison      several runs along one path, and where they part
comparison_picture  the same in Rerun
comparison_figure   the same as a figure
recomputation       recorded and recomputed decisions of a vehicle
recomputation_plot  the same as a figure
recomputation_picture  the same in Rerun
"""
