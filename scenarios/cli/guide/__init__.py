"""What helps to use the commands.

completion   names and keys that a shell offers
reference    fields, topics, reasons, and the contract of a controller
asked        what a scenario asks for, as a table
signals      receivers and sending in words, for it
"""
