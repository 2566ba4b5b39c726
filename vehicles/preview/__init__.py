"""From received poses to the composite trajectory."""
