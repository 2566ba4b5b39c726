"""`convoy gains`: stabilising sets, margins, certificates, propagation, lowest rates.

report         computes the analysis and writes gains.json
results        the typed results and their form as JSON
pictures       curves, and the list of all pictures
set_pictures   the stabilising sets
"""
