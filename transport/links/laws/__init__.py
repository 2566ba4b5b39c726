"""The laws of a directed link, each a class that a line of the registry makes known.

effect         what an effect is given of a message, what it returns and states of itself
moments        losses and delays in the long run
between        the vehicles between sender and receiver
stage          what messages of a link do to one another, behind the effects
law            a law as a table of a scenario file
registry       every law, by the key that requests it
plain          rate, a cut, independent loss, constant latency, uniform jitter
loss/          loss in bursts, by number, as recorded, by reservations
delay/         delay beyond the floor
outages/       when and where a link carries nothing
radio/         what a radio receives over a distance
queue          a queue of bounded rate
normals        standard normal numbers, correlated from one message to the next
content        copies, messages held back, wrong bits
false_content  places that are not true, content of earlier messages, a vehicle that is not there
"""
