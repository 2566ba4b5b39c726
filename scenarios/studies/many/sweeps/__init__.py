"""The same scenario with many values of some keys, and with many seeds: `convoy sweep`.

axis       a key and the values that it takes
figure     a figure of a run's summary, by its name
plan       which runs are asked for, and what of each
sweep      the runs, with a journal; the files that come of them
table      what the runs of each cell show together
pictures   heat maps, lines with bands, distributions over seeds
"""
