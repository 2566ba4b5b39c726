"""Decisions: pose estimate, tracking errors, steering and speed laws, lead and follower."""
