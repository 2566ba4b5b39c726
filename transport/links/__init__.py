"""Directed links: which poses are admitted, and which are delivered when."""
