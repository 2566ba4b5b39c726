"""What followers did about messages that did not come, or that could not be true.

reaction  modes, recoveries, stops and metres driven blind of one follower
watches   events: stops, and sources that are not believed
"""
