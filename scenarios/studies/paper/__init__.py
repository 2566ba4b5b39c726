"""`convoy reproduce`: the paper's experiments run, its claims judged.

reproduce            runs the parts and has the report written
keys                 how runs and results are addressed, and their text
experiments          the runs of each case of Sections V-C and V-D
field_runs           the field experiment of Section V-D, car by car
frequency_response   a convoy behind a lead that drives a sine
fitted_samples       the samples that followers fitted
linear_prediction    what linear theory expects
findings             all results together
claims/              each claim of the paper and the answer to it
report/              report.md, report.json and the pictures
"""
