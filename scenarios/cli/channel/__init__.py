"""Commands and tables about links.

channel_commands   convoy channel show and fit
comparison_tables  a law and a sample of it, for convoy channel show
explanation_table  what a vehicle knew, for convoy explain
"""
