"""Bytes and time on a wire. Knows no protocol."""
