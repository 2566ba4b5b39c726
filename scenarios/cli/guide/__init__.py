"""Shell completion, and `convoy check`."""
