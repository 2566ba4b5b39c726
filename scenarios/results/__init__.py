"""What a run was, live, in virtual time or from its log.

metrics       figures gathered message by message
summary       the typed summary, and its JSON
log_summary   summary and scenario from a log alone
drives        what each vehicle drove, as arrays
review        the picture of a log
"""
