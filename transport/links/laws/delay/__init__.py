"""Laws of the delay beyond the link's minimum latency, each the table of a scenario file."""
