"""Formats of recorded drives: from the bytes of a file to columns of points.

text            text of a file in any encoding
time_cells      times of a table: dates, times of day, numbers
columns         meaning of the columns of a table
table           CSV and its relatives
kitti           KITTI's folders of oxts packets
point_columns   columns of positions that grow point by point
xml_elements    elements of XML files, also of damaged ones
markup          GPX and KML
nmea_sentences  sentences of NMEA 0183 as rows of numbers
nmea            NMEA 0183: the sentences of one instant become one point
geojson         GeoJSON
logs            MCAP: the log of a run, and positions of other programs
registry        the formats, and which of them a file has
"""
