"""Achieved against requested behaviour of the links of a run.

link_figures       the figures of all links, gathered message by message
link_tally         counts of one link, and its false alarms
transport_records  sending and receiving of each vehicle, as the log shows them
account            the fate of each message that was sent over a link
estimates          ratios, bursts and delays with their intervals
link_summary       the figures of one link in the summary
"""
