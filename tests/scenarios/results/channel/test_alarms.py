"""False alarms counted against predicted ones, with a receiver that goes by its clock."""

from dataclasses import replace

import pytest
from scipy.stats import chi2

from scenarios.definition.check.alarms import FalseAlarms, false_alarms
from scenarios.definition.check.sample import StraightDrive
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.channel.alarms import AlarmTally, alarm_miss, alarm_summary
from scenarios.results.channel.estimates import number
from scenarios.results.metrics import Metrics
from tests.made.scenarios.messages import at, gps, tracking, truth
from vehicles.messages import Change, Message, SourceStatus
from vehicles.schedule import SECOND, instants

LINK = ("v1", "v3")
BURSTS = "links.loss={kind='gilbert_elliott',loss_ratio=0.4,burst_messages_mean=4}"


@pytest.mark.parametrize("count", [0, 1, 3, 10, 50, 1000])
@pytest.mark.parametrize("confidence", [0.95, 0.9999])
def test_the_interval_of_a_number_is_garwoods(count: int, confidence: float) -> None:
    tail = 0.5 * (1.0 - confidence)
    low = chi2.ppf(tail, 2 * count) / 2 if count else 0.0
    high = chi2.ppf(1.0 - tail, 2 * count + 2) / 2
    found = number(count, confidence)
    assert found.high == pytest.approx(high, rel=0.01 if count >= 10 else 0.08)
    assert found.low == pytest.approx(low, rel=0.01, abs=0.08)


def test_an_interval_of_a_number_that_comes_in_swarms_is_wider() -> None:
    narrow, wide = number(40, 0.95), number(40, 0.95, 4.0)
    assert wide.low < narrow.low < 40 < narrow.high < wide.high
    assert wide.high - wide.low == pytest.approx(2.0 * (narrow.high - narrow.low), rel=0.1)


def statuses(*some: SourceStatus) -> AlarmTally:
    tally = AlarmTally()
    for instant, status in enumerate(some):
        tally.add(instant, status)
    return tally


def test_each_time_that_a_source_is_lost_is_one_alarm_while_the_sender_lives() -> None:
    tally = statuses("unheard", "fresh", "late", "lost", "lost", "probation", "lost", "fresh")
    assert tally.instants == [3, 6]
    assert (tally.counted(10), tally.counted(5), tally.counted(2)) == (2, 1, 0)
    assert statuses("unheard", "unheard").counted(10) is None


def made_of(scenario: Scenario, messages: int) -> AlarmTally:
    """What a receiver makes of a link that looks at its clock fifty times a second."""
    coming = sorted(
        (there_at, k) for k, there_at in StraightDrive(scenario, LINK, 30.0).arrivals(messages)
    )
    tally, heard_at, place = AlarmTally(), None, 0
    for now in instants(0, messages * SECOND // 20, 50.0):
        while place < len(coming) and coming[place][0] <= now:
            heard_at, place = now, place + 1
        silence = 0 if heard_at is None else now - heard_at
        status: SourceStatus = "lost" if 2 * silence > SECOND else "fresh"
        tally.add(now, "unheard" if heard_at is None else status)
    return tally


@pytest.mark.parametrize("seed", range(8))
def test_bursts_of_four_have_the_alarms_that_were_predicted(seed: int) -> None:
    """Ten minutes each: about 90 alarms, of 40 % loss in bursts of four on average."""
    scenario = load_scenario("lane_change", [BURSTS], seed)
    law, messages = false_alarms(scenario, LINK), 12_000
    summary = alarm_summary(law, messages, made_of(scenario, messages).counted(10**18))
    assert summary.predicted == pytest.approx(72_000 / 6 * 0.1 * 0.75**9, rel=0.002)
    counted = summary.counted or 0
    wide = number(counted, 0.9999, law.dispersion)
    assert wide.low <= (summary.predicted or 0.0) <= wide.high
    assert (summary.low or 0.0) < counted < (summary.high or 0.0)
    assert list(alarm_miss(LINK, law, summary)) == []


def test_other_alarms_than_predicted_are_said() -> None:
    law = false_alarms(load_scenario("lane_change", [BURSTS]), LINK)
    (said,) = alarm_miss(LINK, law, alarm_summary(law, 12_000, 3))
    assert said.startswith("v1 → v3: counted as lost 3 times though it sends, 0.0")
    assert said.endswith("with certainty, predicted 90")
    unknown = replace(law, of_run=lambda _: None)
    assert list(alarm_miss(LINK, unknown, alarm_summary(unknown, 12_000, 3))) == []
    assert list(alarm_miss(LINK, None, alarm_summary(None, 12_000, 3))) == []


def gathered(scenario: Scenario, *more: Message) -> Metrics:
    """Figures of a run in which v3 loses v1 at each second for a while, though v1 sends."""
    metrics = Metrics.of(scenario)
    for seq in range(500):
        metrics.add(truth("v1", seq, 0.6 * seq, 0.0))
        status = "lost" if 10 < seq % 50 < 40 else "fresh"
        metrics.add(tracking("v3", seq, lead_status=status))
        metrics.add(tracking("v2", seq, lead_status=status, predecessor_status="lost"))
    for seq in range(200):
        metrics.add(gps("v1", seq))
    for message in more:
        metrics.add(message)
    return metrics


TABLES = {
    "cut": '{"kind": "cut", "at_s": 1.0, "receiver": "v3"}',
    "speed": '{"kind": "speed", "at_s": 1.0, "speed_mps": 10.0}',
}


def change(vehicle: str, kind: str) -> Change:
    return Change(
        vehicle=vehicle,
        seq=0,
        effective_at_ns=at(1.0),
        kind=kind,
        by_hand=False,
        table=TABLES[kind],
    )


def test_the_summary_holds_prediction_and_count_side_by_side() -> None:
    scenario = load_scenario("lane_change", ["links.loss_ratio=0.1"])
    metrics = gathered(scenario)
    links = {(row.sender, row.receiver): row.false_alarms for row in metrics.link_summaries()}
    assert links["v1", "v3"].counted == links["v1", "v2"].counted == 10
    assert links["v2", "v3"].counted == 0
    assert links["v3", "v4"].counted is None
    assert links["v1", "v3"].predicted == pytest.approx(190 * 0.9 * 0.1**10, rel=0.02)
    said = [line for line in metrics.link_misses() if "counted as lost" in line]
    assert len(said) == 2
    assert all("10 times" in line for line in said)


@pytest.mark.parametrize(("kind", "said"), [("cut", 1), ("speed", 2)])
def test_of_links_that_were_changed_nothing_is_predicted(kind: str, said: int) -> None:
    scenario = load_scenario("lane_change", ["links.loss_ratio=0.1"])
    metrics = gathered(scenario, change("v3", kind))
    assert sum("counted as lost" in line for line in metrics.link_misses()) == said


def test_the_law_of_a_link_is_asked_for_once() -> None:
    asked = []

    def law(link: tuple[str, str]) -> FalseAlarms | None:
        asked.append(link)
        return None

    scenario = load_scenario("lane_change")
    metrics = Metrics(scenario.vehicle_names, scenario.links, alarms_of=law)
    metrics.link_summaries()
    metrics.link_summaries()
    assert sorted(asked) == sorted(scenario.links)
