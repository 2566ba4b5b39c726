"""The report of a reproduction.

report            report.md
machine_readable  report.json
tables            tables of report.md
experiment_plots  plots
"""
