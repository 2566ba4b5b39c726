"""The command line: `convoy COMMAND …`."""
