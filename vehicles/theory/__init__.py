"""The steered car as a linear system, and the convoy as a chain of such systems.

linear_model       error dynamics of the car relative to a path: matrices, characteristic polynomial
polynomials        Routh-Hurwitz criterion, stationary points, exact arithmetic
gain_sets          the set of stabilising gains
gain_margins       distance of chosen gains from the boundary of that set
constant_speed     proof of stability at all constant speeds of an interval
varying_speed      certified accelerations
mean_acceleration  bounds on the integral of the acceleration
propagation        transfer functions from car to car
simulated_chain    propagation simulated in time
sampled_loop       the loop with its actual rates, hold and filter; lowest stable rates
string_stability   norms, bands and weights of the propagation
"""
