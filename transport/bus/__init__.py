"""Publish and subscribe bytes by key.

bus             interface of a bus
zenoh_bus       bus over Zenoh, and the router
zenoh_options   Zenoh's usual flags and the convoy's defaults
memory_bus      bus within one process, for virtual time and tests
telemetry       batches of messages for log and picture
"""
