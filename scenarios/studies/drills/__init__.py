"""Failure drills: scenarios in which something fails, with limits that must hold.

drill        drills with their seeds, and the rows of their limits
files        the rows as JSON and JUnit XML
worst        the instant at which a burst does most harm, found by search
worst_files  the instant found, as a drill and as JSON
"""
