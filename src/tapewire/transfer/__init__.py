"""One job on one line, from opening it to its proof: what the command line, the library and the server call."""
