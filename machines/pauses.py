"""Python's own pauses: none of them may fall into a motion on a port.

Now and then Python looks at every object it knows for those that nobody can reach any more. With what a session has
loaded that takes 40 ms and more, at any moment, and nobody hears a heartbeat meanwhile.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def nothing_old_looked_at() -> Iterator[None]:
    """What is here now is collected once and then left alone until the end; what comes later is collected as ever."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
