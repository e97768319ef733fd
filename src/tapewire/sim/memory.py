"""How much memory something holds."""

from __future__ import annotations

import gc
import sys

__all__ = ["footprint"]


def footprint(root: object) -> int:
    """Bytes held by everything reachable from `root` that is not a module, a class or a function."""
    seen: set[int] = set()
    total, waiting = 0, [root]
    while waiting:
        thing = waiting.pop()
        if id(thing) in seen or isinstance(thing, type) or callable(thing) or type(thing).__name__ == "module":
            continue
        seen.add(id(thing))
        total += sys.getsizeof(thing)
        waiting.extend(gc.get_referents(thing))
    return total
