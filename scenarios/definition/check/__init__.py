"""What a scenario asks for before it is run, and what deserves a warning."""
