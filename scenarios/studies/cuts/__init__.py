"""Convoys whose links are cut: random cuts, compared over reactions or with path history.

roads          roads of the campaign, as tables of scenarios
cut            one cut, and its scenario
received_path  the path that a follower received, and whether it sufficed to stop
road_record    errors, departures and collisions of a run
cut_figures    figures of the followers in one run
run_figures    figures of whole runs, and of all runs with one variant
campaign       random cuts, simulated with each variant
error_plots    errors, runs that leave the lane, and distances driven blind
"""
