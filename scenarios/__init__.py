"""Scenarios, the runs of them, what came of it, and the command line.

cli/                 the commands, what they print, how they fail
studies/             many runs and the theory: stabilising gains, the paper's claims
runs/                one run: nodes, processes, virtual time, the recorder
results/             what a run was: figures, summary, drives, review
definition/          what a scenario says: schema, road, traces, check
library/             the scenarios and recorded drives that ship
"""
