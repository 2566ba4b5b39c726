"""`convoy reference`: pages generated from the tables and classes that rule.

reference_command  the command, and the list of pages
printing           texts and rows at the width of a terminal
table_keys         keys of a scenario's tables with ranges, defaults and documentation
scenario_pages     scenario, links, presets, gnss, degradation, limits
drives_page        formats, columns and keys of recorded drives
message_pages      topics, wire, reasons, .proto
plug_in_page       plug-ins
plug_in_examples   examples of user-defined classes
string_page        string-stability
other_pages        fields, intervals, exit-codes
"""
