"""What a run was: its figures, its summary, its drives, and its picture again."""
