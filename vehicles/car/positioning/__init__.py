"""Errors of a receiver's positions."""
