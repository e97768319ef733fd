"""What goes wrong on a line: plans as values, presets with names, and what carries them out."""
