"""The laws of a directed link: effects that drop a message or delay it, each small and pure.

effect         what every one of them is given and answers
plain          rate, independent loss, constant latency, uniform jitter
normals        standard normal numbers, correlated from one message to the next
radio          what a radio receives over a distance
"""
