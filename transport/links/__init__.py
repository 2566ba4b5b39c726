"""Directed links in the receiver, and what comes through them.

effects   the impairments: rate, loss, latency, jitter
link      the verdict of one link on one message
gate      which poses can be true at all
inbox     what one vehicle receives, tick by tick
"""
