"""The tables of a scenario file: keys with units, defaults and limits.

base_table       common base class
settings_table   tables generated from settings classes
path_tables      the path: segments, a recorded trace, or points
gnss_table       GNSS receivers and their presets
flow_table       information flow
link_tables      directed links
change_tables    changes to a running convoy
limit_rows       the table of limits
limit_tables     `[limits]`
log_table        rates of the log
replay_table     vehicles that repeat a recorded run
plug_ins/        classes selected by name
scenario_tables  all other tables, and the whole file
"""
