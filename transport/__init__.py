"""What carries messages and time: bytes, clock, links, bus, log, viewer."""
