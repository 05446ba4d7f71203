"""What the governor makes of exchanges: hiccups are no reason, a slow host is, and calm brings everything back."""

import pytest

from machines.governor import CALM_NS, FIRST_AFTER, Advice, Governor, HostDelays
from nmc.budget import BusTiming
from nmc.program import Evidence, Exchange

TIMING = BusTiming.at(115200, jitter_max_ns=200_000)
MS = 1_000_000


class Host:
    """Answers that come ``excess_ns`` later than foreseen at worst."""

    def __init__(self) -> None:
        self.governor = Governor(TIMING)
        self.now_ns = 10 * MS

    def answer(self, excess_ns: int = 0, late_ns: int = 0) -> Advice | None:
        exchange = Exchange(1, 4, bytes(4), send_at_ns=self.now_ns)
        sent_ns = self.now_ns + late_ns
        self.now_ns = sent_ns + TIMING.worst_ns(4) + excess_ns
        return self.governor.observe(Evidence(exchange, sent_ns, self.now_ns, 1))

    def answers(self, count: int, excess_ns: int = 0) -> list[Advice]:
        return [advice for _ in range(count) if (advice := self.answer(excess_ns)) is not None]


def test_what_was_foreseen_is_no_reason() -> None:
    host = Host()
    assert host.answers(1000) == []
    assert host.answers(1000, 100_000) == []
    assert host.governor.share == 1.0


def test_hiccups_are_assumed_from_then_on_and_the_third_slows() -> None:
    host = Host()
    host.answers(50)
    assert host.answers(1, 2 * MS) == [Advice(2_200_000, 1.0)]
    assert host.answers(1, 2 * MS) == []
    [advice] = host.answers(1, 2 * MS)
    assert advice.jitter_max_ns == 2_200_000
    exchange_ns = TIMING.worst_ns(4)
    assert advice.share == pytest.approx((exchange_ns / (exchange_ns + 2 * MS)) ** 0.5, abs=0.05)


def test_a_slow_host_is_known_after_a_few_exchanges() -> None:
    host = Host()
    said = host.answers(FIRST_AFTER, MS)
    assert [advice.jitter_max_ns for advice in said] == [1_200_000]
    assert host.answers(200, MS) == []


def test_it_rises_by_a_quarter_at_least_and_falls_after_a_calm_time() -> None:
    host = Host()
    host.answers(10, 4 * MS)
    [advice] = host.answers(3, 4 * MS + 200_000)
    assert advice.jitter_max_ns == 5_200_000
    begin_ns = host.now_ns
    said = []
    while host.now_ns < begin_ns + 3 * CALM_NS:
        said += host.answers(1)
        known = {each.jitter_max_ns for each in said} - {5_200_000}
        assert not known or host.now_ns - begin_ns > CALM_NS - 50 * MS
    assert said[-1] == Advice(200_000, 1.0)
    assert min(each.share for each in said) == pytest.approx(0.45)


def test_late_exchanges_count_like_long_ones() -> None:
    host = Host()
    for _ in range(FIRST_AFTER):
        host.answer(late_ns=3 * MS)
    assert host.governor.share == pytest.approx(0.6)
    assert host.governor.delays.late == FIRST_AFTER


def test_an_exchange_that_did_not_leave_is_a_reason() -> None:
    host = Host()
    host.answers(20)
    exchange = Exchange(1, 4, bytes(4), send_at_ns=host.now_ns, not_after_ns=host.now_ns + 1)
    for _ in range(3):
        host.governor.observe(Evidence(exchange, host.now_ns + MS, host.now_ns + MS, None, sent=False))
    assert host.governor.share == pytest.approx(0.65)


def test_delays_are_kept_as_quantiles() -> None:
    delays = HostDelays()
    assert delays.quantile_ns(0.99) == 0
    for delay_ns in range(0, 1_000_000, 1000):
        delays.add(delay_ns)
    assert delays.quantile_ns(0.5) == 500_000
    assert delays.quantile_ns(0.99) == 1_000_000
    assert delays.greatest_ns == 999_000


def test_the_speed_follows_no_more_often_than_the_path_may_be_timed_anew() -> None:
    host = Host()
    host.answers(FIRST_AFTER, MS)
    first = host.governor.share
    [advice] = host.answers(20, 4 * MS)
    assert advice == Advice(4_200_000, first)
    said = []
    while not said:
        said = host.answers(1, 4 * MS)
    assert said[0].share < first
    assert host.now_ns > 400 * MS


def test_what_was_asked_for_after_its_time_is_not_the_hosts_doing() -> None:
    host = Host()
    host.answers(50)
    for _ in range(5):  # due two milliseconds before the answer that came before it
        exchange = Exchange(0x81, 5, send_at_ns=host.now_ns - 2 * MS)
        sent_ns = host.now_ns
        host.now_ns += TIMING.worst_ns(0)
        assert host.governor.observe(Evidence(exchange, sent_ns, host.now_ns, 1)) is None
    assert host.governor.delays.late == 0
