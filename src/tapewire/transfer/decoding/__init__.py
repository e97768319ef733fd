"""Captures in the words of their protocol: as text, as a chart, and live."""
