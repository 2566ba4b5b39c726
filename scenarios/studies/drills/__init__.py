"""Failure drills: scenarios in which something fails, with limits that must hold.

drill        drills with their seeds, and the rows of their limits
drill_files  the rows as JSON and JUnit XML
worst        search for the instant at which a burst does most harm
worst_files  that instant as a drill and as JSON
"""
