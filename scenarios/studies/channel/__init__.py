"""Channels: what a log says of the links that it was recorded over.

recorded    the fates, delays and distances of the messages of each link of a log
estimate    one parameter of a law, with its interval
fit_loss    loss, its bursts, outages and loss over distance, with their intervals
fit_delay   the law of a delay, with its intervals
fit         a link as a block of a scenario that gives that channel again
"""
