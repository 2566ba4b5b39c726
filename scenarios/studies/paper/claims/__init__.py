"""Claims of the paper, each registered with the function that answers it.

claim             types, registration and verdicts of claims
model             Sections II, III-B and III-D: the car, signs, the feedforward
trajectory        Sections III-A and III-B: samples, line test, circle
theory            Sections III-F and IV: stability and string stability
gains             Sections V-A and V-B: gain sets, loads
base_case         Section V-C.1: the base case
other_cases       Sections V-C.2 and V-C.3: other speeds and loads, varying speed
string_stability  the simulations by Definition 1, in L2, and off the lead's path
other_laws        beyond the paper: Stanley and pure pursuit
field_experiment  Section V-D: the field experiment
information       beyond the paper: weight α, noise, preview, loss and latency varied
"""
