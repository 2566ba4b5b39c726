"""`convoy reproduce`: the paper's experiments run, its claims judged."""
