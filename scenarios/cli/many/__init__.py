"""Commands that simulate many runs."""
