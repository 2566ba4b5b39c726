"""Drivers: the lead steers along its path, followers along the poses they received."""
