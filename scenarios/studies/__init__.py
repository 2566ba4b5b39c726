"""Many runs and the theory behind them.

channel/        `convoy channel`: what a log says of its links
cuts/           `convoy channel cuts`: all messages stop, and what followers make of it
drills/         `convoy drill`: what must hold when something fails
engine/         the jobs of a study on cores or on a dask scheduler, its journal and files
gains/          `convoy gains`: stabilising gain sets, margins, certificates
many/           answers from many runs: sweeps, drills, boundaries, risk, blame
paper/          `convoy reproduce`: the paper's experiments run, its claims judged
axis_labels     labels with units
picture_style   style and formats of the plots
"""
