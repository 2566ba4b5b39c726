"""What a scenario says: read, refused in clear lines, or resolved to all that a run needs."""
