"""The laws of a directed link: effects that drop a message or delay it, each small and pure.

effect         what every one of them is given and answers
plain          rate, independent loss, constant latency, uniform jitter
outages        when and where a link carries nothing
chains         loss in bursts: Gilbert–Elliott, four states
patterns       loss by number: every n-th, listed, recorded, as in an earlier run
radio/         what a radio receives over a distance, and what collides
delay          laws of delay beyond the floor
normals        standard normal numbers, correlated from one message to the next
gamma          the gamma law as a function of a normal number
queue          a queue of bounded rate, and arrival in order
content        copies, messages held back, wrong bits
false_content  places that are not true, content of earlier messages, a vehicle that is not there
"""
