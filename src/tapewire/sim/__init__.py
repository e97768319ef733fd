"""The simulated world: a control behind its remote buffer, a clock that jumps, and transcripts."""
