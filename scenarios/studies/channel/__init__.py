"""`convoy channel`: laws against samples, the laws of recorded links, and what channels cost.

law         what the laws say of bursts, delays and distances
comparison  all figures of a link, of its laws and of a sample
picture     the same, drawn
fitting/    the laws of the links of a log
costs/      what loss, bursts and latency cost a convoy
"""
