"""Publish and subscribe bytes by key.

bus             what every bus does, and how it fails
zenoh_bus       over Zenoh, and its router
zenoh_options   Zenoh's usual flags and the convoy's defaults
memory_bus      within one process, in virtual time and in tests
"""
