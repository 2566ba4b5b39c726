"""`convoy gains`: stabilising sets, margins, certificates, propagation.

report         works all of it out and writes gains.json
results        the typed results and their form as JSON
sampled        lowest stable rates of control and sensors
pictures       curves, and the list of all pictures
set_pictures   the stabilising sets
"""
