"""The steered car as a linear system: stability, gain sets, how errors pass down the convoy."""
