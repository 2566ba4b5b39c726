"""Each claim of the paper above the function that answers it.

claim         what a claim is, how it is registered and judged
model         Sections II and III: the car, the trajectory, the law
theory        Sections III-F and IV: stability and string stability
gains         Sections V-A and V-B: gain sets, loads
base          Section V-C.1: the base case
other_cases   Sections V-C.2 and V-C.3: other speeds and loads, varying speed
field         Section V-D: the field experiment
"""
