"""Laws of a directed link, each a class and a line of the registry.

effect              interface of an effect: input, verdict, properties
moments             losses and delays in the long run
vehicles_between    vehicles between sender and receiver
stage               effects of messages on each other
link_law            base of laws as tables of a scenario file
registry            all laws, by the key that requests them
basic               rate, cut, independent loss, constant latency, uniform jitter
loss/               burst losses, losses by number, recorded losses, collisions
delay/              delay beyond the latency
outages/            times and places without delivery
radio/              losses over the distance
queue               queue of limited rate
correlated_normals  standard normal numbers, correlated from message to message
content             duplicates, reordering, bit errors
false_content       false positions, repeated content, a ghost vehicle
"""
