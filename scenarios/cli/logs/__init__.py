"""Logs as files: convoy info, recover."""
