"""Failure drills: scenarios in which something fails, with limits that must hold.

drill        drills with their seeds, and the rows of their limits
drill_files  the rows as JSON and JUnit XML
"""
