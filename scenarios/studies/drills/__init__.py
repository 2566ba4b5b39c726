"""Failure drills: scenarios in which something fails, with limits that must hold all the same.

drill     one of them with one seed, and what came of each of its limits
campaign  many of them, with many seeds, as a table and for machines
junit     the same as JUnit XML
worst     the instant at which a burst does most harm, found by search
written   what the search found, as a drill and for machines
"""
