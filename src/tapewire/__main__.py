"""`python -m tapewire` is the command `tapewire`."""

from __future__ import annotations

from tapewire.cli import main

if __name__ == "__main__":
    main(prog_name="tapewire")
