"""Failure drills: scenarios in which something fails, with limits that must hold."""
