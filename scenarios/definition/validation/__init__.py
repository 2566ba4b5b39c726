"""Error lines for scenario files, with hints.

wording        how values and keys appear in a line
model_fields   the fields of a pydantic model at the location of an error
units          units of keys and of values
hints          what an invalid key or value was probably meant to be
problem_lines  pydantic errors as lines
"""
