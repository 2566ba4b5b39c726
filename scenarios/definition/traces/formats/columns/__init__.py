"""Columns of tables: what they hold.

units         units by name, and degrees in other forms
column_names  what the columns of a table hold, by their names
table_layout  separator, header and used columns
table_times   which columns hold the time, and its likely unit
"""
