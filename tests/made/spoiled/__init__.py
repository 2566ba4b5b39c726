"""Synthetic drives, their files in all formats, and faults of recorders and exports.

synthetic_drives  roads, motions, and recordings of them
record_faults     faults of a recording: times, positions, speeds, heights, order
drive_files       files of a recording: tables, markup, sentences, logs
file_faults       faults of a file: encodings, bad rows, truncated ends, damage
drawn_drives      random drives and faults as strategies of hypothesis
driven_paths      drive a file, and compare it with the unspoiled one
"""
