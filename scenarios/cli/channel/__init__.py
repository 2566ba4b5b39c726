"""What links are asked for and do, for a person.

commands     convoy channel show and fit
costs        convoy channel figure
cut_costs    convoy channel cuts
asked_links  what is asked of each link, for convoy check --explain
shown        a law against a sample of it
explained    what a vehicle knew, for convoy explain
"""
