"""Rules for sending fixes, independent of the rate of measuring.

When a rule triggers, the newest fix is sent, if it has not been sent before.

rule           interface of all rules
congestion     reactive congestion control, for any rule
every_fix      each fix
fixed_rate     at a constant rate
profile        at a changing rate
awareness      as cooperative awareness messages
intervals      at random intervals
sending_rules  all rules by their kind
path_history   the path history that a vehicle sends with its pose
sender         a vehicle's sender
"""
