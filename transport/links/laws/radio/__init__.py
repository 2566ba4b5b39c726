"""What a radio receives: over a distance, past other vehicles, with resources held by others.

over_distance  what all radios have in common
table          a table over distance, with losses of each message or of whole reservations
path_loss      path loss, noise and packet errors
shadowing      how strength wavers with the metres driven
obstruction    what the vehicles in between cost
reservations   which messages are sent with the same resources
"""
