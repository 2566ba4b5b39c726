"""False alarms of a link: how often its receiver counted the sender as lost."""

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.channel.link_tally import AlarmTally
from scenarios.results.metrics import Metrics
from tests.made.scenarios.messages import gps, tracking, truth
from vehicles.messages import Message, SourceStatus


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


def gathered(scenario: Scenario, *more: Message) -> Metrics:
    """Figures of a run in which v3 loses v1 at each second for a while, though v1 sends."""
    metrics = Metrics.of(scenario)
    for seq in range(500):
        metrics.listen(0, truth("v1", seq, 0.6 * seq, 0.0))
        status = "lost" if 10 < seq % 50 < 40 else "fresh"
        metrics.listen(0, tracking("v3", seq, lead_status=status))
        metrics.listen(0, tracking("v2", seq, lead_status=status, predecessor_status="lost"))
    for seq in range(200):
        metrics.listen(0, gps("v1", seq))
    for message in more:
        metrics.listen(0, message)
    return metrics


def test_the_summary_holds_the_count_of_each_link() -> None:
    scenario = load_scenario("lane_change", ["links.loss_ratio=0.1"])
    metrics = gathered(scenario)
    links = {(row.sender, row.receiver): row.false_alarms for row in metrics.link_summaries()}
    assert links["v1", "v3"].counted == links["v1", "v2"].counted == 10
    assert links["v2", "v3"].counted == 0
    assert links["v3", "v4"].counted is None
