"""The report of a reproduction.

report     report.md and report.json
tables     its tables
pictures   its pictures
"""
