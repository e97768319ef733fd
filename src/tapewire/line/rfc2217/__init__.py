"""Serial ports at the other end of a TCP connection that tells of them (RFC 2217): either end."""
