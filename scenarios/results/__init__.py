"""Figures, events and summary of a run, live, in virtual time or from its log."""
