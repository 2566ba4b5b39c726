"""`convoy channel`: compare laws with samples, fit laws to logs, study the cost of channels.

predictions      burst lengths, delays and distances predicted by the laws of a link
comparison       figures of a link, predicted and sampled
comparison_plot  plot of the comparison
fitting/         fit laws to the links of a log
cost_drives      runs over many channels, and the largest error of each
cost_report      plot and JSON of these runs
"""
