"""The steered car as a linear system, and the convoy as a chain of such systems.

linear_model       the car in its errors against a path: matrices, characteristic polynomial
polynomials        Routh-Hurwitz, stationary points, exact arithmetic
gain_sets          the gains that stabilise the car
gain_margins       distance of chosen gains from the boundary of that set
constant_speed     stability proven at every speed between two
varying_speed      certified accelerations
mean_acceleration  bounds on the integral of the acceleration
propagation        transfer functions from car to car
simulated_chain    the same in time
sampled_loop       the loop as it is run: rates, hold, filter; lowest stable rates
string_stability   norms, bands and weights of the propagation
"""
