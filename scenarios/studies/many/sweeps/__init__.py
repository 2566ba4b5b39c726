"""The same scenario with many values of some keys, and with many seeds: `convoy sweep`.

axis        a key and the values that it takes
figure      a figure of a run's summary, by its name
plan        the runs of a sweep, and the figures and limits of each
sweep       the runs, with a journal, and the files
cell_table  statistics of the runs of each cell
heat_maps   heat maps, lines with bands, distributions over seeds
"""
