"""NC programs as moves."""
