"""Fit laws to recorded links, as a TOML block that reproduces them."""
