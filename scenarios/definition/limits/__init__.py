"""Limits on what followers do by an instant.

problems   those that no run could keep, or that nobody could check
"""
