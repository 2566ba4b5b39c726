"""`convoy reproduce`: the paper's experiments run, its claims judged.

reproduce             carries out the parts and has the report written
keys                  by which runs and results are addressed, and their text
experiments           the runs of each case; field_runs: the field experiment, car by car
frequency_response    a convoy behind a lead that drives a sine
fitted_samples        the samples that followers fitted; linear_prediction: what theory expects
findings              all results together
claims/               each claim of the paper and the answer to it
report/               report.md, report.json and the pictures
"""
