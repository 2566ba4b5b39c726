"""Publish and subscribe bytes: over Zenoh, or in memory."""
