"""What of a run was recorded, and what was not.

holes  what was not recorded
"""
