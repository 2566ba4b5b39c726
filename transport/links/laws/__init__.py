"""The laws of a directed link: effects that drop a message or delay it, each small and pure.

effect    what every one of them is given and answers
plain     rate, independent loss, constant latency, uniform jitter
normals   standard normal numbers, correlated from one message to the next
gamma     the gamma law as a function of a normal number
delay     laws of delay beyond the floor
queue     a queue of bounded rate, and arrival in order
outages   when and where a link carries nothing
"""
