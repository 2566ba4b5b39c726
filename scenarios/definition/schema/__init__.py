"""The tables of a scenario file: keys with units, defaults and limits."""
