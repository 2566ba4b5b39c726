"""Directed links, in the receiving node, and the messages they deliver."""
