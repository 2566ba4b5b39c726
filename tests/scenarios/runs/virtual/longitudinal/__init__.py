"""Longitudinal control of whole convoys."""
