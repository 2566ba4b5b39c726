"""`convoy channel`: compare laws with samples, fit laws to logs.

predictions      burst lengths, delays and distances predicted by the laws of a link
comparison       figures of a link, predicted and sampled
comparison_plot  plot of the comparison
fitting/         fit laws to the links of a log
"""
