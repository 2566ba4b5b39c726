"""Laws of loss, each the table of a scenario file.

base         base of user-defined laws
number_sets  sets of message numbers
by_number    one message of every N, listed messages, a recorded pattern, no loss
chains       Markov chains that step with each message
bursts       Gilbert–Elliott model, and the four states of netem
earlier_run  losses and delays recorded in an earlier run
collisions   loss of whole reservations, as in LTE-V2X
"""
