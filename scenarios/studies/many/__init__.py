"""Studies that simulate one scenario many times."""
