"""Synthetic drives, their files in all formats, and faults of recorders and exports."""
