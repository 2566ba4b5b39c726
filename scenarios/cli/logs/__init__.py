"""Logs as files: convoy info, extract, merge, recover.

info_command      what a log holds
piece_commands    extract and merge
recover_command   a readable log from a truncated or damaged one
"""
