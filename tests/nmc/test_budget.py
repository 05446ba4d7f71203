"""Bus arithmetic against the sample divisors of the PIC-STEP data sheet, section 5.1, Set Baud Rate."""

import pytest

from nmc.budget import BusTiming, module_byte_ns


@pytest.mark.parametrize(("baud", "byte_us"), [(9600, 1040.0), (19200, 512.0), (57600, 168.0), (115200, 88.0)])
def test_a_byte_takes_ten_bits_at_the_chips_own_rate(baud: int, byte_us: float) -> None:
    # Divisors 129, 63, 20 and 10 of a 20 MHz clock with BRGH = 1: 16 (BRD + 1) / 20 MHz a bit.
    assert module_byte_ns(baud) == byte_us * 1000


def test_smallest_exchange_is_four_bytes_out_and_two_back() -> None:
    timing = BusTiming.at(115200)
    assert timing.command_ns(0) == 4 * 86_805
    assert timing.reply_ns(0) == 2 * 88_000
    assert timing.worst_ns(0) == timing.command_ns(0) + 500_000 + timing.reply_ns(0)


def test_the_reply_bounds_the_outbound_delay() -> None:
    timing = BusTiming.at(115200, jitter_max_ns=2_000_000)
    first, last, likely = timing.execution_window_ns(0, timing.command_ns(4) + timing.reply_ns(0) + 300_000, 4)
    assert first == likely == timing.command_ns(4)
    assert last == first + 300_000 + 250_000


def test_a_module_answers_within_half_a_millisecond_so_a_late_answer_tells_of_a_late_command() -> None:
    timing = BusTiming.at(115200, jitter_max_ns=2_000_000)
    first, last, likely = timing.execution_window_ns(0, timing.command_ns(4) + timing.reply_ns(0) + 1_900_000, 4)
    assert first == timing.command_ns(4)  # for certain: the host may have looked at its port late
    assert likely == first + 1_900_000 - 500_000  # section 3.1
    assert last == first + 1_900_000 + 250_000


def test_what_is_read_was_read_between_command_and_answer() -> None:
    timing = BusTiming.at(115200, jitter_max_ns=2_000_000)
    sent_ns = 1_000_000
    replied_ns = sent_ns + timing.command_ns(1) + 1_200_000 + timing.reply_ns(4)
    window = timing.reading_window_ns(sent_ns, replied_ns, 1, 4)
    assert window.earliest_ns == sent_ns + timing.command_ns(1)
    assert window.latest_ns == window.earliest_ns + 1_200_000
    assert window.likely_ns == window.latest_ns - timing.reply_delay_max_ns  # a module answers within 0.5 ms
    early = timing.reading_window_ns(sent_ns, sent_ns + timing.command_ns(1), 1, 4)
    assert early.earliest_ns == early.likely_ns == early.latest_ns
