"""The car: its parameters, its motion and its sensors."""
