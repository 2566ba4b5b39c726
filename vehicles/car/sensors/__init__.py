"""Sensors of the own motion and of the gap ahead."""
