"""`convoy sweep`: one scenario with many values of some keys, and many seeds.

axis        a key and its values
figure      figures of a summary by name
plan        the runs of a sweep, with the figures and limits to evaluate
sweep       the runs, with a journal, and the files
cell_table  statistics of the runs of each cell
picture     lines with intervals, or heat maps
"""
