"""`convoy channel`: laws against samples, the laws of recorded links, and what channels cost.

predictions      what the laws predict of bursts, delays and distances
comparison       all figures of a link, of its laws and of a sample
comparison_plot  the same, drawn
fitting/         the laws of the links of a log
cost_drives      drives over many channels, and what each cost a convoy
cost_report      the same as a plot and as JSON
"""
