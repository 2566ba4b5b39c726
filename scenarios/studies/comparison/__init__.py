"""Comparisons of runs: `convoy diff` and `convoy compare`.

run_diff            what differs between two runs or two groups of runs
settings_diff       settings that differ
message_diff        the first differing message
figure_diff         figures, and the noise over seeds
run_comparison      several runs along one path, and where they part
comparison_picture  the same in Rerun
comparison_figure   the same as a figure
"""
