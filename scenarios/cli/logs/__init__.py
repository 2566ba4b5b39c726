"""Logs as files: convoy info, recover.

info_command      what a log holds
recover_command   a readable log from a truncated or damaged one
"""
