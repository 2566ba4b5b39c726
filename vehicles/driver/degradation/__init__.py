"""Reactions of a follower to missing and to false messages."""
