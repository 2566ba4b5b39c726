"""Radio laws: losses by distance, by vehicles in between and by shared resources.

radio_law     base class
table_radio   delivery ratio over distance by a table
path_loss     path loss, noise and packet errors
shadowing     variation of the signal strength over the distance travelled
obstruction   loss caused by vehicles between sender and receiver
reservations  messages sent with the same resources
"""
