"""Laws of loss, each a class that is the table of a scenario file.

numbers      sets of message numbers
by_number    one message of every N, listed messages, a recorded pattern, no loss
chains       Markov chains that step with each message
bursts       Gilbert and Elliott, and the four states of netem
earlier_run  the fates and delays of an earlier run
collisions   whole reservations, as in LTE-V2X
"""
