"""Laws of loss, each a class that is the table of a scenario file.

numbers          sets of message numbers
none             no loss
chains           Markov chains that step with each message
gilbert_elliott  a good and a bad state
four_state       the four states of netem
every_nth        one message of every N
listed           listed messages
pattern          a recorded pattern
earlier_run      the fates and delays of an earlier run
collisions       whole reservations, as in LTE-V2X
"""
