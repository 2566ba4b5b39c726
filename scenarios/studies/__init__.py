"""Studies: many runs, and the theory behind them.

channel/        `convoy channel`: laws of links, fitted and compared
comparison/     `convoy diff` and `convoy compare`
drills/         `convoy drill`: limits that must hold when something fails
engine/         parallel runs, locally or on a dask scheduler, with a journal
gains/          `convoy gains`: stabilizing gain sets, margins, certificates
many/           sweeps, boundaries, and attribution of losses
paper/          `convoy reproduce`: the experiments and claims of the paper
run_list        `convoy runs`: the runs in a folder
drive_picture   `convoy check --output`: a recorded drive
axis_labels     labels with units
picture_style   style and formats of the plots
"""
