"""What the links of a run did, against what was requested.

figures     the figures of all links, gathered message by message
tally       what is kept of one link while a run goes on
alarms      how often a source counted as lost although it sent
estimates   ratios, bursts and delays with their intervals
account     the figures of one link in the summary
"""
