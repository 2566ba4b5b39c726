"""`convoy figure`: standard figures of the field, each from a few sweeps.

study               a figure: its sweeps, and its points with intervals
cacc                longitudinal laws over loss and beacon rate
error_along_string  lateral errors by vehicle for different sources
loss_over_gap       the cost of loss and latency over the gap
registry            the figures by name
drawing             lines with intervals
simulated           the simulated sweeps, and the files
"""
