"""Fit laws to recorded links, as a TOML block that reproduces them.

recorded       fates, delays and distances of the messages on each link of a log
estimate       an estimated parameter and its interval
fit_loss       loss, bursts and outages
fit_radio      loss over distance, independent or per reservation
fit_shadowing  loss that varies slowly along the path
fit_delay      distribution of the delay
fit            TOML block of the links of a log
"""
