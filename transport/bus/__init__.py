"""Publish and subscribe bytes by key."""
