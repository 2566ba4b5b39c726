"""Commands and tables about links: laws and their costs.

channel_commands   convoy channel show and fit
campaign_commands  convoy channel figure and cuts
comparison_tables  a law and a sample of it, for convoy channel show
explanation_table  what a vehicle knew, for convoy explain
"""
