"""Scenarios, their runs, what came of them, the command line and the Python interface.

cli/          the commands: what they take, what they print, how they fail
api/          the package `convoy`: runs and logs from Python
studies/      many runs and the theory: stabilising gains, the paper's experiments and claims
runs/         one run: its vehicles as nodes, its processes, virtual time, the recorder
results/      what a run was: figures, summary, drives, review
definition/   what a scenario says: files, schema, road, traces, links, check
library/      the scenarios and recorded drives that ship
"""
