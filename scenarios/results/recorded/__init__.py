"""Recorded runs as tables, for the Python interface and for export."""
