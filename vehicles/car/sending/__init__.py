"""Rules for sending fixes, independent of the rate of measuring.

When a rule triggers, the newest fix is sent, if it has not been sent before.
"""
