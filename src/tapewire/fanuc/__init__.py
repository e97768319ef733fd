"""What is FANUC and belongs to no protocol: the text of programs as controls read and punch it."""
