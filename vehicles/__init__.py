"""Vehicles and their decisions: pure functions of state, time and messages."""
