"""Shell completion, and the table of `convoy check`.

completion   names and keys that a shell offers
check_table  the configuration of a scenario as a table
"""
