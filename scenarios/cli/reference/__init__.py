"""`convoy reference`: pages generated from the tables and classes that rule."""
