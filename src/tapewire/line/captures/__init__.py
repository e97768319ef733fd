"""All that is said on a line, on record."""
