"""Error lines for scenario files, with hints."""
