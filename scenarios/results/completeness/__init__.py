"""What of a run was recorded, and what was not.

recorded_numbers  which messages were recorded, by their numbers
holes             what was not recorded
"""
