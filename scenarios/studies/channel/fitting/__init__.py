"""The laws of recorded links, as a block of a scenario that reproduces them.

recorded       the fates, delays and distances of the messages of each link of a log
estimate       one parameter of a law, with its interval
fit_loss       loss, its bursts and outages, with their intervals
fit_radio      loss over distance, on its own or by reservations
fit_shadowing  loss that varies slowly along the path
fit_delay      the law of a delay, with its intervals
fit            a link as a block of a scenario
"""
