"""The steered car as a linear system, and the convoy as a chain of such systems."""
