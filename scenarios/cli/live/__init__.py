"""Commands for a running convoy."""
