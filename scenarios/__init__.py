"""Scenarios, their runs, what came of them, the command line and the Python interface."""
