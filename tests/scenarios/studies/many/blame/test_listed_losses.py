"""A run with exactly the losses that one says: those of its log give its log, others only these."""

from pathlib import Path

import pytest

from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.runs.observer import OnMessage
from scenarios.runs.virtual.drive import drive as virtual_drive
from scenarios.studies.many.blame.listed_losses import loss_free
from scenarios.studies.many.blame.losses import LostMessage
from scenarios.studies.many.blame.rerun import NO_END, first_difference
from tests.scenarios.studies.many.blame.lossy_logs import LAWS, recorded
from vehicles.messages import LinkVerdict, Message


def fates(scenario: Scenario) -> dict[tuple[str, str, int], tuple[str, int]]:
    """Of each message that a link judged why it was dropped, and when it was visible (ns)."""
    found = {}

    def listen(_at: int, message: Message) -> None:
        if isinstance(message, LinkVerdict):
            key = message.sender, message.vehicle, message.pose_seq
            found[key] = message.reason, message.visible_at_ns

    virtual_drive(scenario, [OnMessage(listen)]).raise_fault()
    return found


@pytest.mark.spread(4)
@pytest.mark.parametrize("law", LAWS)
def test_the_log_s_losses_give_the_log_s_poses_and_fewer_only_what_was_given_back(
    law: str, tmp_path: Path
) -> None:
    run = recorded(law, tmp_path)
    lost = run.lost(NO_END)
    assert lost
    convoy = loss_free(run)
    as_sent_to_workers = scenario_from_text(convoy.with_losses(lost).text)
    assert first_difference(as_sent_to_workers, run.truth) is None

    still_lost, given_back = lost[::2], lost[1::2]
    before, after = fates(convoy.with_losses(lost)), fates(convoy.with_losses(still_lost))
    back = {(*one.link, one.number) for one in given_back}
    for key, (reason, visible_at) in before.items():
        if law == "in bursts, in order":  # what comes back holds up what was sent after it
            assert after[key][1] >= visible_at
        else:
            assert after[key][1] == visible_at
        assert after[key][0] == ("" if key in back else reason)


def test_without_losses_nothing_is_lost_and_with_one_it_alone(tmp_path: Path) -> None:
    run = recorded("by place, rate and reservation", tmp_path)
    convoy = loss_free(run)
    kept = {key for key, (reason, _) in fates(convoy.scenario).items() if not reason}
    assert {number for *_, number in kept} < set(range(31))  # the link's own rate stays
    alone = LostMessage(
        sent_at=0, link=("v1", "v2"), number=min(n for _, r, n in kept if r == "v2")
    )
    left = {key for key, (reason, _) in fates(convoy.with_losses([alone])).items() if not reason}
    assert kept - left == {("v1", "v2", alone.number)}


@pytest.mark.parametrize("law", ["independent", "a queue"])
def test_the_scenario_written_is_the_one_that_was_driven(law: str, tmp_path: Path) -> None:
    run = recorded(law, tmp_path)
    limit = Limit("cross_track_error_m_max", 0.25)
    smallest = loss_free(run).smallest(run.lost(NO_END), limit, "some losses")
    again = scenario_from_text(smallest.text)
    assert again.text == smallest.text
    assert again.tables.limits.cross_track_error_m_max == 0.25
    assert first_difference(again, run.truth) is None
