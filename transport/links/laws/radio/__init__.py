"""What a radio receives: over a distance, past other vehicles, with resources held by others.

delivery       a table over distance; or path loss, noise and packet errors
shadowing      how strength wavers with the metres driven
obstruction    what the vehicles in between cost
reservations   which messages are sent with the same resources
"""
