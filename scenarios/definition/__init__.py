"""Scenario files: read, validated and resolved."""
