"""Classes that a scenario selects by name, shipped or user-defined, with tables of parameters.

guards     calls of user-defined classes, with faults in one line
point      a plug-in point, and the classes that fit it
table      the table that selects a class and has its parameters
steering   lateral controllers
following  longitudinal controllers
path       fusions, and degradation policies
channel    laws of loss and of delay
emission   sending rules, and errors of receivers
measures   events and figures
points     all plug-in points
"""
