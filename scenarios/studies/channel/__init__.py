"""Channels: what a log says of the links that it was recorded over, and laws against samples.

recorded    the fates, delays and distances of the messages of each link of a log
estimate    one parameter of a law, with its interval
fit_loss    loss, its bursts, outages and loss over distance, with their intervals
fit_delay   the law of a delay, with its intervals
fit         a link as a block of a scenario that gives that channel again
sample      messages of one link, drawn by the effects of a run
law         what the laws say of bursts, delays and distances
comparison  all figures of a link, of its laws and of a sample
picture     the same, drawn
"""
