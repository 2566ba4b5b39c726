"""Recorded runs as tables, for the Python interface and for export.

run_record       a log as tables by vehicle and link
data_table       tables of NumPy columns
tidy_tables      one table of all vehicles, and one of all links
table_files      CSV, Parquet and GPX
true_figures     true errors and gaps at each true pose
frequency_gains  gains along the string by frequency
modes            changes of the mode of a vehicle
body_columns     distances between bodies at many instants
link_outcomes    outcome of each sent message
column_messages  messages made from columns
"""
