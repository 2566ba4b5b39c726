"""`convoy reproduce`: run the paper's experiments and judge its claims.

reproduce            runs all parts and writes the report
keys                 keys of runs and results, and their text
experiments          runs of each case of Sections V-C and V-D
field_runs           field experiment of Section V-D, car by car
frequency_response   convoy behind a lead that drives a sine
fitted_samples       samples fitted by the followers
linear_prediction    errors predicted by linear theory
findings             all results together
claims/              the claims of the paper and their answers
report/              report.md, report.json and the plots
"""
