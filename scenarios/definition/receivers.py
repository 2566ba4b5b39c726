"""The errors of a vehicle's GNSS receiver, from what its table asks for."""

from collections.abc import Iterator
from functools import cache
from math import hypot
from typing import get_args

from scenarios.definition.schema.gnss import (
    OF_STATE,
    PRESETS,
    ChainOfStates,
    CircleOutageTable,
    DriftTable,
    Fix,
    GnssTable,
    OutageOfFix,
    ScheduledStates,
    StateErrorsTable,
    TimeOutageTable,
)
from vehicles.car.positioning.fix_states import (
    BlindCircle,
    FixStates,
    Outage,
    ReceiverState,
    RoadOutage,
    StateChain,
    StateSchedule,
    TimeOutage,
)
from vehicles.car.positioning.gnss_errors import (
    Bias,
    ErrorModel,
    ReceiverErrors,
    StateErrors,
    Streams,
    Wander,
)
from vehicles.messages import FixState
from vehicles.schedule import MILLISECOND, nanoseconds

WITH_A_FIX: tuple[FixState, ...] = get_args(FixState)


def receiver_errors(
    table: GnssTable, start_at: int, behind: float, own: Streams, shared: Streams
) -> ReceiverErrors:
    """Errors of a receiver that starts at `start_at` (ns), beside plain white noise.

    `behind` (m) is how far behind the lead the vehicle starts. `own` are the streams of random
    numbers of this receiver, `shared` those of all, by purpose.
    """
    return ReceiverErrors(
        model=error_model(table),
        states=_states(table, start_at, own),
        outages=tuple(_outage(one, start_at, behind) for one in table.outages),
        start_at=start_at,
        own=own,
        shared=shared,
    )


def error_model(table: GnssTable) -> ErrorModel:
    """All that is wrong with the positions of a receiver."""
    bias = table.bias
    return ErrorModel(
        states={state: _errors(errors_in(table, state)) for state in WITH_A_FIX},
        common=_wander(table.common_drift),
        bias=Bias(bias.deviation_m, bias.east_m, bias.north_m) if bias else Bias(),
        quantum=table.quantisation_m,
        latency=round(table.latency_ms * MILLISECOND),
    )


def errors_in(table: GnssTable, state: FixState) -> StateErrorsTable:
    """Errors in a state: the receiver's own in its `fix`, else those of the state."""
    key = f"while_{state}"
    if state == table.fix:
        return table
    own: StateErrorsTable | None = getattr(table, key)
    if own is not None:
        return own
    return _usual_errors(OF_STATE[key])


@cache
def _usual_errors(preset: str) -> StateErrorsTable:
    figures = {one: value for one, value in PRESETS[preset].items() if one != "fix"}
    return StateErrorsTable.model_validate(figures)


def states_of(table: GnssTable) -> set[Fix]:
    """The states that a receiver can be in, outages apart."""
    found: set[Fix] = {table.fix}
    states = table.fix_states
    if states is not None and states.kind == "schedule":
        found |= {entry.state for entry in states.entries}
    elif states is not None:
        found |= {transition.to for transition in states.transitions}
    return found


def assumed_deviation(table: GnssTable) -> float:
    """Standard deviation (m) per axis of what others receive, in the worst state it can be in.

    Without what all have in common, which moves nobody against another. Errors that last are in
    it: two sources are that far apart, however smooth each of them is.
    """
    if table.is_plain:
        return table.position_noise_m
    model = error_model(table)
    found = [model.deviation(state, shared=False) for state in _with_a_fix(table)]
    return max(found, default=table.position_noise_m)


def lasting_deviation(table: GnssTable) -> float:
    """Standard deviation (m) per axis of drawn errors that last, in the worst state it can be in.

    Without white noise, which is averaged, and what all have in common.
    """
    model = error_model(table)
    drifts = [model.states[state].drift.deviation for state in _with_a_fix(table)]
    return hypot(max(drifts, default=0.0), model.bias.deviation)


def _with_a_fix(table: GnssTable) -> list[FixState]:
    """The states with a fix that a receiver can be in."""
    return [state for state in WITH_A_FIX if state in states_of(table)]


def own_deviation(table: GnssTable) -> float:
    """Standard deviation (m) per axis in the state that a receiver begins in."""
    if table.is_plain or table.fix == "none":
        return table.position_noise_m
    return error_model(table).deviation(table.fix)


def receiver_problems(table: GnssTable) -> Iterator[tuple[str, str]]:
    """Give every key of a receiver's table that does not fit the others."""
    yield from _state_problems(table)
    states = table.fix_states
    if states is not None and states.kind == "schedule":
        yield from _entry_problems(table.fix, states)
    elif states is not None:
        yield from _transition_problems(states)
    for index, one in enumerate(table.outages):
        if one.kind == "time" and one.to_s <= one.from_s:
            yield f"outages[{index}].to_s", f"given {one.to_s:g}, allowed more than {one.from_s:g}"
        if one.kind == "road" and one.to_m <= one.from_m:
            yield f"outages[{index}].to_m", f"given {one.to_m:g}, allowed more than {one.from_m:g}"


def _state_problems(table: GnssTable) -> Iterator[tuple[str, str]]:
    others: dict[str, StateErrorsTable | None] = {key: getattr(table, key) for key in OF_STATE}
    given = {key: errors for key, errors in others.items() if errors is not None}
    for key in given:
        if key == f"while_{table.fix}":
            yield key, f'given for fix = "{table.fix}", whose errors stand in gnss itself'
        elif table.fix_states is None:
            yield key, "given without fix_states, which it is about"
    for key, errors in {"": table, **given}.items():
        if errors.entry_jump_m is not None and errors.drift is None:
            name = f"{key}.entry_jump_m" if key else "entry_jump_m"
            yield name, "given without drift, which begins anew with it"


def _entry_problems(before: Fix, states: ScheduledStates) -> Iterator[tuple[str, str]]:
    at_s = -1.0
    for index, entry in enumerate(states.entries):
        key = f"fix_states.entries[{index}]"
        if entry.at_s <= at_s:
            yield f"{key}.at_s", f"given {entry.at_s:g}, allowed more than {at_s:g}, the one before"
        if entry.state == before:
            yield f"{key}.state", f'given "{entry.state}", which it is already'
        before, at_s = entry.state, entry.at_s


def _transition_problems(states: ChainOfStates) -> Iterator[tuple[str, str]]:
    seen: set[tuple[Fix, Fix]] = set()
    for index, one in enumerate(states.transitions):
        key = f"fix_states.transitions[{index}].to"
        if one.state == one.to:
            yield key, f'given "{one.to}", allowed another state than the one it leaves'
        elif (one.state, one.to) in seen:
            yield key, f'from "{one.state}" to "{one.to}" is given twice, allowed once'
        seen.add((one.state, one.to))


def _errors(table: StateErrorsTable) -> StateErrors:
    return StateErrors(
        table.position_noise_m, _wander(table.drift), table.entry_jump_m, table.accuracy_ratio
    )


def _wander(table: DriftTable | None) -> Wander:
    return Wander(table.deviation_m, table.time_constant_s) if table else Wander()


def _states(table: GnssTable, start_at: int, own: Streams) -> FixStates:
    states = table.fix_states
    if states is None:
        return StateSchedule(table.fix, (), start_at)
    if states.kind == "schedule":
        entries = [(entry.at_s, entry.state) for entry in states.entries]
        return StateSchedule(table.fix, entries, start_at)
    means: dict[ReceiverState, dict[ReceiverState, float]] = {}
    for one in states.transitions:
        means.setdefault(one.state, {})[one.to] = one.mean_s
    return StateChain(table.fix, means, start_at, own("states"))


def _outage(table: OutageOfFix, start_at: int, behind: float) -> Outage:
    if isinstance(table, TimeOutageTable):
        return TimeOutage(start_at + nanoseconds(table.from_s), start_at + nanoseconds(table.to_s))
    if isinstance(table, CircleOutageTable):
        return BlindCircle(table.east_m, table.north_m, table.radius_m)
    return RoadOutage(table.from_m, table.to_m, behind)
