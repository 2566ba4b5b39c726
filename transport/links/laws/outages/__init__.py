"""Outages of a link, each law the table of a scenario file."""
