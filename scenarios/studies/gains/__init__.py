"""`convoy gains`: stabilising sets, margins, certificates, propagation, lowest rates.

report           computes the analysis and writes gains.json
results          the typed results and their form as JSON
stability_plots  curves, and the list of all plots
gain_set_plots   the stabilising sets
"""
