"""Commands that make tables of recorded runs."""
