"""Commands and tables about links."""
