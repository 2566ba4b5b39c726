"""Commands and tables about links: their configuration, laws, costs.

commands       convoy channel show and fit
costs          convoy channel figure and cuts
checked_links  the configuration of each link, for convoy check --explain
shown          a law against a sample of it
explained      what a vehicle knew, for convoy explain
"""
