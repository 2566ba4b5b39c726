"""Rules of sending fixes, independent of the rate of measuring.

At an instant of sending the newest fix is sent, none twice: without a new fix nothing is sent.

rule        interface of all rules
congestion  reactive congestion control, under any rule
every_fix   each fix
fixed_rate  at a rate
profile     at a rate that changes
awareness   as cooperative awareness messages
intervals   at drawn intervals
sending_rules  all rules by their kind
sender      a vehicle's sender
"""
