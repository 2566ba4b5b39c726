"""Figures and warnings of a scenario before it runs.

findings        figures of the lead's planned run, and all warnings
drive_report    facts of a recorded drive and of its path
drive_warnings  warnings of recorded drives
confirmation    settings that run only with --yes
lap             convoys that are longer than a lap of their closed path
preview         whether followers receive enough poses of the path ahead
hard_braking    hardest braking of the lead that followers hold without contact
receivers       whether receivers are accurate enough to follow another car's path
link_forecast   laws and expected figures of each link
false_alarms    how often a source counts as lost although it sends
link_sample     sampled messages of one link
steering_loop   sampled loop, slip in bends, certificate for changes of speed, largest alpha
"""
