"""Errors of a receiver in a recorded drive: jumps, and standstills that drift."""
