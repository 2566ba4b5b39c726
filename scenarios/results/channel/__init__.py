"""Achieved against requested behaviour of the links of a run.

figures     the figures of all links, gathered message by message
tally       counts of one link, and its false alarms
estimates   ratios, bursts and delays with their intervals
account     the figures of one link in the summary
"""
