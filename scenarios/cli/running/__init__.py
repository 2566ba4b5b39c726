"""Commands that drive a convoy."""
