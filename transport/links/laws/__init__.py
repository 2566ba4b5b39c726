"""The laws of a directed link: effects that drop a message or delay it, each small and pure.

effect         what every one of them is given and answers
plain          rate, independent loss, constant latency, uniform jitter
normals        normal numbers by message, correlated
radio          delivery over distance: a table, or path loss and noise
shadowing      how strength wavers with the metres driven
obstruction    what vehicles in between cost
reservations   which messages are sent with the same resources
"""
