"""Laws of loss, each the table of a scenario file."""
