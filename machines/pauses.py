"""Python's own pauses: none of them may fall into a motion on a port.

Now and then Python looks at every object it knows for those that nobody can reach any more. With what a session has
loaded that takes 40 ms and more, at any moment, and nobody hears a heartbeat meanwhile.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

_inside: list[None] = []
"""One for each that is open: the outermost collects."""


@contextmanager
def nothing_old_looked_at() -> Iterator[None]:
    """What is here now is collected once and then left alone until the end; what comes later is collected as ever.

    The collection takes a tenth of a second and more: whoever fixes when something begins does so inside of this.
    Inside of another one it does nothing.
    """
    _inside.append(None)
    try:
        if len(_inside) == 1:
            gc.collect()
            gc.freeze()
        yield
    finally:
        _inside.pop()
        if not _inside:
            gc.unfreeze()
