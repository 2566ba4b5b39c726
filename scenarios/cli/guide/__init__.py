"""Help with the use of the commands.

completion  names and keys that a shell offers
reference   fields, topics, reasons, and the contract of a controller
checked     the configuration of a scenario as a table
"""
