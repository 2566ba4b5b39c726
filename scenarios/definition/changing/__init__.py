"""Changes to a running convoy: their effects, and requests by hand."""
