"""The report of a reproduction: report writes it, with tables and pictures."""
