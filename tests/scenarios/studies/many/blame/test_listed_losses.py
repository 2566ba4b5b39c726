"""Reruns with listed losses: all losses of a log reproduce it; a subset loses only the subset."""

from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.runs.observer import OnMessage
from scenarios.runs.virtual import drive as virtual_drive
from scenarios.runs.virtual import run_tables
from scenarios.studies.many.losses import NO_END, LostMessage, RecordedRun, loss_free
from tests.scenarios.studies.many.blame.lossy_logs import LAWS, recorded
from vehicles.messages import LinkVerdict, Message


def fates(scenario: Scenario) -> dict[tuple[str, str, int], tuple[str, int]]:
    """Drop reason and instant of visibility (ns) of each message."""
    found = {}

    def listen(_at: int, message: Message) -> None:
        if isinstance(message, LinkVerdict):
            key = message.sender, message.vehicle, message.pose_seq
            found[key] = message.reason, message.visible_at_ns

    virtual_drive(scenario, [OnMessage(listen)]).raise_fault()
    return found


def is_reproduced(text: str, run: RecordedRun) -> bool:
    """Whether a run of this scenario has the true poses of the recorded one."""
    again, _ = run_tables(scenario_from_text(text))
    return all(
        np.array_equal(again.table(name, "truth")[axis], run.tables.table(name, "truth")[axis])
        for name in run.tables.names
        for axis in ("east_m", "north_m")
    )


@pytest.mark.spread(4)
@pytest.mark.parametrize("law", LAWS)
def test_the_losses_of_a_log_reproduce_it_and_a_subset_restores_the_rest(
    law: str, tmp_path: Path
) -> None:
    run = recorded(law, tmp_path)
    lost = run.lost(NO_END)
    assert lost
    convoy = loss_free(run)
    as_sent_to_workers = convoy.with_losses(lost).text
    assert is_reproduced(as_sent_to_workers, run)

    still_lost, restored = lost[::2], lost[1::2]
    before, after = fates(convoy.with_losses(lost)), fates(convoy.with_losses(still_lost))
    restored_keys = {(*message.link, message.number) for message in restored}
    for key, (reason, visible_at) in before.items():
        if law == "in bursts, in order":  # restored messages delay later ones
            assert after[key][1] >= visible_at
        else:
            assert after[key][1] == visible_at
        assert after[key][0] == ("" if key in restored_keys else reason)


def test_no_loss_or_a_single_one_is_reproduced(tmp_path: Path) -> None:
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
def test_the_written_scenario_reproduces_the_run(law: str, tmp_path: Path) -> None:
    run = recorded(law, tmp_path)
    limit = Limit("cross_track_error_m_max", 0.25)
    smallest = loss_free(run).smallest(run.lost(NO_END), limit, "some losses")
    again = scenario_from_text(smallest.text)
    assert again.text == smallest.text
    assert again.tables.limits.cross_track_error_m_max == 0.25
    assert is_reproduced(again.text, run)
