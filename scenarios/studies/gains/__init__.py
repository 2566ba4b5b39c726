"""`convoy gains`: stabilising sets, margins, certificates, propagation, lowest rates.

report           computes the analysis and writes gains.json
results          typed results and their JSON form
stability_plots  plots of curves, and the list of all plots
gain_set_plots   plots of the stabilising sets
"""
