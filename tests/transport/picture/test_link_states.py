"""The state of a link in half a second follows from its messages."""

import pytest

from tests.made.transport import drive
from transport.columns import columns_from
from transport.picture.series import CARRIED, message_states, window_state


@pytest.mark.parametrize(
    ("outcomes", "state", "share"),
    [
        (["ok"] * 10, "ok", 0.0),
        (["ok"] * 9 + ["late"], "late", 0.0),
        (["ok"] * 8 + ["late", "loss"], "10 % lost", 0.1),
        (["ok"] * 99 + ["loss"], "10 % lost", 0.01),  # some were lost, so not "ok"
        (["ok"] * 6 + ["loss"] * 4, "40 % lost", 0.4),
        (["loss"] * 99 + ["ok"], "90 % lost", 0.99),  # not all were lost
        (["loss"], "100 % lost", 1.0),
        (["ok", "rate"] * 5, "ok", 0.0),
        (["ok", "rate", "rate", "loss", "rate", "ok"], "30 % lost", 1 / 3),
        (["rate"], "silent", float("nan")),
    ],
)
def test_state_of_one_window(outcomes: list[str], state: str, share: float) -> None:
    verdicts = [drive.verdict("v2", "v1", k, k, outcome) for k, outcome in enumerate(outcomes)]
    states = message_states(columns_from("verdict", verdicts, range(len(verdicts)))).tolist()
    shown, loss_ratio = window_state(*map(states.count, CARRIED))
    assert shown == state
    assert loss_ratio == pytest.approx(share, nan_ok=True)
