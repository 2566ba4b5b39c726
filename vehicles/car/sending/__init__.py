"""When a vehicle sends which of its fixes, apart from when it measures.

At an instant of sending the newest fix goes out, and none goes out twice: without a newer one than
was sent last nothing is sent, and the instant is lost.

rule        what every rule has to be
congestion  reactive congestion control, under any rule
every_fix   each fix
fixed_rate  at a rate
profile     at a rate that changes
awareness   as cooperative awareness messages
intervals   at drawn intervals
registry    all rules by their kind
sender      a vehicle's sender
"""
