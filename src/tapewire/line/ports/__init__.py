"""The serial ports of this computer: what they are, how they are opened, and how they run as lines."""
