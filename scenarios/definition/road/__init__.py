"""The lead's path and speed, and recorded motions of followers."""
