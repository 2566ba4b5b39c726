"""Figures of single vehicles."""
