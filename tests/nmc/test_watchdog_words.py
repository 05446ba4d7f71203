"""The words that a host and its watchdog process share are never seen half written."""

import subprocess
import sys
import tempfile

from nmc.watchdog_process import WORDS_BYTES, SharedWords

WRITER = """
import select, sys
from nmc.watchdog_process import WORDS_BYTES, SharedWords
words = SharedWords(int(sys.argv[1]))
words.put(3, 1)
while not select.select([sys.stdin], [], [], 0)[0]:
    for _ in range(2000):
        words.put(0, 0x0123456789ABCDEF)
        words.put(0, 0x7EDCBA9876543210)
"""


def test_no_reader_ever_sees_half_a_word() -> None:
    with tempfile.TemporaryFile() as file:
        file.truncate(WORDS_BYTES)
        words = SharedWords(file.fileno())
        words.put(0, 0x0123456789ABCDEF)
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(file.fileno())], stdin=subprocess.PIPE, pass_fds=(file.fileno(),)
        )
        assert writer.stdin is not None
        try:
            while not words.get(3):
                assert writer.poll() is None
            seen = set[int]()
            while len(seen) < 2:
                seen |= {words.get(0) for _ in range(300_000)}
        finally:
            writer.stdin.close()
            writer.wait()
            words.close()
    assert seen == {0x0123456789ABCDEF, 0x7EDCBA9876543210}
