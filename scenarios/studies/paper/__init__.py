"""`convoy reproduce`: run the paper's experiments and judge its claims.

reproduce            runs the parts and writes the report
keys                 keys of runs and results, and their text
experiments          the runs of each case of Sections V-C and V-D
field_runs           the field experiment of Section V-D, car by car
frequency_response   a convoy behind a lead that drives a sine
fitted_samples       the samples that followers fitted
linear_prediction    errors predicted by linear theory
findings             all results together
claims/              each claim of the paper and the answer to it
report/              report.md, report.json and the pictures
"""
