"""Each claim of the paper above the function that answers it, a module per part of the paper.

claim                      what a claim is, how it is registered and judged
model, theory, gains       Sections II and III; III-F and IV; V-A and V-B
base, other_cases, field   Sections V-C.1; V-C.2 and V-C.3; V-D
"""
