"""The report of a reproduction.

report            report.md
machine_readable  report.json
tables            its tables
experiment_plots  its plots
"""
