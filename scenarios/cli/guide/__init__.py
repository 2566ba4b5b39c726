"""Shell completion, and `convoy check`.

completion     scenarios that a shell offers
checking       `convoy check`: the reports, and the picture of a drive
check_table    the configuration of a scenario as a table
drive_table    a recorded drive as a table
link_settings  the configuration of each link, for --explain
"""
