"""Receivers and rules of sending that mean nothing: one clear line each."""

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import scenario_from_text
from tests.made.scenarios.messages import STRAIGHT

CHAIN = "gnss.fix_states={kind='chain', transitions=[{state='fixed', to='float', mean_s=9.0}]}"
LIST = "gnss.fix_states={kind='schedule', entries=[%s]}"
UNEVEN = ("links.rate_hz=10", "sending.kind=cam")
BROKEN = {
    "no such rule": (("sending.kind='often'",), "sending.kind", 'given "often"', '"every_fix"'),
    "a rule without its kind": (
        ("sending={rate_hz=5}",), "sending.rate_hz", "unknown key", '"fixed"',
    ),
    "a rate without a rule": (
        ("sending={kind='fixed'}",), "sending.rate_hz", "missing", "rate_hz",
    ),
    "a key of another rule": (
        ("sending={kind='cam', rate_hz=5}",), "sending.rate_hz", "unknown key", '"fixed"',
    ),
    "no rate": (("sending={kind='fixed', rate_hz=0}",), "sending.rate_hz", "given 0", "0.01"),
    "a phase beyond the period": (
        ("sending={kind='fixed', rate_hz=10, phase_s=0.1}",),
        "sending.phase_s", "given 0.1", "less than 0.1",
    ),
    "two phases": (
        ("sending={kind='cam', phase_s=0.01, drawn_phase=true}",),
        "sending.phase_s", "drawn_phase", "one of them",
    ),
    "checked too rarely": (
        ("sending={kind='cam', check_period_ms=200}",),
        "sending.check_period_ms", "given 200", "1 to 100",
    ),
    "an empty profile": (
        ("vehicle.v2.sending={kind='profile', profile=[]}",),
        "vehicle.v2.sending.profile", "given []", "at least one entry",
    ),
    "a profile out of order": (
        ("sending={kind='profile', profile=[{at_s=2, rate_hz=1}, {at_s=2, rate_hz=5}]}",),
        "sending.profile[1].at_s", "given 2", "more than 2",
    ),
    "intervals of nobody": (
        ("sending.kind='intervals'",), "sending.table", "missing", '"cam_vw_highway"',
    ),
    "two tables": (
        ("sending={kind='intervals', table='cam_vw_highway', intervals_ms=[10]}",),
        "sending.table", "together with intervals_ms", "one of them",
    ),
    "shares of other intervals": (
        ("sending={kind='intervals', intervals_ms=[100, 200], shares_ratio=[1]}",),
        "sending.shares_ratio", "given 1 numbers", "allowed 2",
    ),
    "no shares at all": (
        ("sending={kind='intervals', intervals_ms=[100], shares_ratio=[0]}",),
        "sending.shares_ratio", "given only 0", "above 0",
    ),
    "more jitter than interval": (
        ("sending={kind='intervals', table='cam_vw_highway', jitter_ms=25}",),
        "sending.jitter_ms", "given 25", "100 ms",
    ),
    "a channel more than busy": (
        ("sending={kind='every_fix', dcc={busy=[{at_s=1, busy_ratio=60}]}}",),
        "sending.dcc.busy[0].busy_ratio", "given 60", "0 to 1",
    ),
    "busy in no order": (
        ("sending.kind=cam", "sending.dcc.busy=[{at_s=3, busy_ratio=0}, {at_s=1, busy_ratio=0}]",),
        "sending.dcc.busy[1].at_s", "given 1", "more than 3",
    ),
    "a link's rate of uneven messages": (UNEVEN, "links.rate_hz", "given 10", '"fixed"'),
    "and that of one link": (
        ("link=[{sender='v1', receiver='v2', rate_hz=3}]", "vehicle.v1.sending.kind=cam"),
        "link[0].rate_hz", "v1 does not send periodically", '"every_fix"',
    ),
    "a rate under congestion control": (
        ("links.rate_hz=10", "sending={kind='cam', dcc={busy=[{at_s=0, busy_ratio=0.9}]}}"),
        "links.rate_hz", "given 10", "without dcc",
    ),
    "no such preset": (("gnss.preset='rtk'",), "gnss.preset", 'given "rtk"', '"rtk_fixed"'),
    "no such fix": (("gnss.fix='good'",), "gnss.fix", 'given "good"', '"single"'),
    "drift without a size": (
        ("gnss.drift={time_constant_s=3}",), "gnss.drift.deviation_m", "missing", "deviation",
    ),
    "drift that is noise": (
        ("gnss.drift={deviation_m=1, time_constant_s=0.01}",),
        "gnss.drift.time_constant_s", "given 0.01", "0.1 to 100000",
    ),
    "a jump of nothing": (("gnss.entry_jump_m=1",), "gnss.entry_jump_m", "without drift", "drift"),
    "errors of a state that never is": (
        ("gnss.while_float.position_noise_m=1",), "gnss.while_float", "without", "fix_states",
    ),
    "errors of a state given twice": (
        (CHAIN, "gnss.while_fixed.position_noise_m=1"), "gnss.while_fixed", '"fixed"', "gnss",
    ),
    "a state that leads to itself": (
        (CHAIN.replace("float", "fixed"),),
        "gnss.fix_states.transitions[0].to", 'given "fixed"', "another state",
    ),
    "a stay without a length": (
        (CHAIN.replace("9.0", "0"),),
        "gnss.fix_states.transitions[0].mean_s", "given 0", "at least|0.01 to",
    ),
    "states in no order": (
        (LIST % "{at_s=3, state='float'}, {at_s=2, state='fixed'}",),
        "gnss.fix_states.entries[1].at_s", "given 2", "more than 3",
    ),
    "a state that is there already": (
        (LIST % "{at_s=3, state='fixed'}",),
        "gnss.fix_states.entries[0].state", 'given "fixed"', "already",
    ),
    "an outage that ends before it begins": (
        ("gnss.outages=[{kind='time', from_s=3, to_s=2}]",),
        "gnss.outages[0].to_s", "given 2", "more than 3",
    ),
    "a tunnel of no length": (
        ("vehicle.v3.gnss.outages=[{kind='road', from_m=3, to_m=3}]",),
        "vehicle.v3.gnss.outages[0].to_m", "given 3", "more than 3",
    ),
    "an outage of no kind": (
        ("gnss.outages=[{from_m=3, to_m=4}]",), "gnss.outages[0].kind", "missing", '"circle"',
    ),
    "an accuracy of nothing": (
        ("gnss.accuracy_ratio=0",), "gnss.accuracy_ratio", "given 0", "more than 0",
    ),
    "fixes of long ago": (("gnss.latency_ms=9000",), "gnss.latency_ms", "given 9000", "0 to 5000"),
}  # fmt: skip
"""What is laid over a valid scenario; the key, what was given and what is allowed."""


@pytest.mark.parametrize(("changes", "key", "given", "allowed"), BROKEN.values(), ids=BROKEN)
def test_an_invalid_value_gets_one_line(
    changes: tuple[str, ...], key: str, given: str, allowed: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(STRAIGHT, label="a.toml", overrides=changes)
    (line,) = caught.value.lines
    assert f": {key}: " in line
    assert given in line
    assert any(word in line for word in allowed.split("|"))
    assert "\n" not in line
    assert len(line) < 250
