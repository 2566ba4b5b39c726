"""Columns of tables: what they hold."""
