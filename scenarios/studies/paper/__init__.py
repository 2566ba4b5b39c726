"""`convoy reproduce`: run the paper's experiments and judge its claims."""
