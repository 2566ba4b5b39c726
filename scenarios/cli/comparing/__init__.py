"""Commands that compare runs.

diff        `convoy diff`
diff_table  its tables
compare     `convoy compare`
"""
