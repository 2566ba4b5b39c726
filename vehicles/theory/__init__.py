"""The steered car as a linear system: stability, gain sets, how errors pass down the convoy.

linear_model       the car in its errors against a path: matrices and characteristic polynomial
polynomials        Routh-Hurwitz, stationary points, exact arithmetic
gain_sets          which gains stabilise the car; gain_margins: how far chosen ones are inside
constant_speed     stability proven between two speeds; varying_speed: certified accelerations
propagation        transfer functions from car to car; simulated_chain: the same in time
string_stability   norms, bands and weights of the propagation
"""
