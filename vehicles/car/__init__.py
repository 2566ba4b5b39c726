"""The car: its parameters and load, how it moves, and what its GNSS receiver measures."""
