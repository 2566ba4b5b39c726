"""Commands that make tables of recorded runs.

export_command  tables and tracks as files
runs_command    the runs of a folder
"""
