"""From received poses to the composite trajectory: traces, their windows, and the fit."""
