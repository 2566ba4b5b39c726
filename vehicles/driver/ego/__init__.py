"""State estimation of the own car."""
