"""Commands about channels, for a person.

commands  the group of them
figure    convoy channel figure
"""
