"""The lead's path and speed, and where everyone starts."""
