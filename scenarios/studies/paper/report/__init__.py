"""The report on the paper: text, tables and pictures."""
