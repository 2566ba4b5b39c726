"""A run to simulate and its faults, drawn from a seed: each seed draws which kinds it uses."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from random import Random
from typing import Any

from tests.scenarios.runs.simulation.network import NetworkSettings
from vehicles.schedule import MILLISECOND, SECOND

Fault = tuple[Any, ...]
"""Kind, instant (ns), and further values: see `World._cause`."""
MEASURED = ("speed.followers=gap", "control.longitudinal=acc", "gap_sensor.range_m=100")
"""Overrides of a convoy whose followers measure the gap, and so need true poses in time."""
FOREVER = 10**18
ROUTER, RECORDER, LAUNCHER = "router", "recorder", "launcher"


@dataclass(frozen=True, slots=True, kw_only=True)
class HostError:
    """Clock error of a host: offset (ns) and drift (share)."""

    offset: int = 0
    drift: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A run: how it is started, what its network and clocks are like, and its faults.

    launched      by `convoy run`, which starts all processes on one host
    variant       scenario, as overrides
    starts        when each process is started by hand (ns), if not launched
    preempted     how often a role is interrupted as it reads its clock
    interruption  longest interruption (ns)
    foreign       vehicle that runs the scenario with another seed
    full_at       number of the write of the log or summary at which the disk is full
    full_for      number of writes that fail
    """

    seed: int
    launched: bool = True
    variant: tuple[str, ...] = ()
    vehicles: int = 2
    duration_s: float = 1.0
    gather_s: float = 10.0
    wait_s: float = 20.0
    network: NetworkSettings = field(default_factory=NetworkSettings)
    hosts: tuple[HostError, ...] = ()
    starts: tuple[tuple[str, int], ...] = ()
    preempted: float = 0.0
    interruption: int = 0
    foreign: str = ""
    full_at: int | None = None
    full_for: int = FOREVER
    disk_error: int = 0
    faults: tuple[Fault, ...] = ()

    @property
    def names(self) -> list[str]:
        return [f"v{number}" for number in range(1, self.vehicles + 1)]

    @property
    def roles(self) -> list[str]:
        return [RECORDER, *self.names]


def draw(seed: int) -> Plan:
    """Draw a plan: first which kinds of fault it has, then the faults."""
    random = Random(seed)
    vehicles = random.choice((2, 2, 3, 4))
    launched = random.random() < 0.5
    plan = Plan(
        seed=seed,
        launched=launched,
        vehicles=vehicles,
        duration_s=random.choice((1.0, 1.0, 2.0)),
        gather_s=random.choice((3.0, 10.0)),
        wait_s=random.choice((5.0, 20.0)),
        variant=(*_variant(random), *(MEASURED if seed % 4 == 3 else ())),
    )
    if not launched:
        spread = random.choice((SECOND // 10, SECOND, 4 * SECOND))
        plan = replace(plan, starts=tuple((role, random.randrange(spread)) for role in plan.roles))
    share = random.choice((0.1, 0.2, 0.4))
    for change in CHANGES:
        if random.random() < share:
            plan = change(plan, random)
    for kind in FAULTS:
        if random.random() < share:
            faults = tuple(kind(plan, random) for _ in range(random.choice((1, 1, 2))))
            plan = replace(plan, faults=plan.faults + faults)
    return replace(plan, faults=tuple(sorted(plan.faults, key=lambda fault: int(fault[1]))))


def _variant(random: Random) -> Iterator[str]:
    if random.random() < 0.5:
        yield 'convoy.on_vehicle_failure="continue"'
    if random.random() < 0.5:
        yield "limits.cross_track_error_m_max=50"


# ---- Properties of the network, the hosts and the disk


def _network(**bounds: tuple[float, float]) -> Callable[[Plan, Random], Plan]:
    def change(plan: Plan, random: Random) -> Plan:
        values: dict[str, Any] = {}
        for name, (low, high) in bounds.items():
            value = random.uniform(low, high)
            values[name] = value if name.endswith("ratio") else round(value * SECOND)
        return replace(plan, network=replace(plan.network, **values))

    return change


def _clocks(plan: Plan, random: Random) -> Plan:
    if plan.launched:
        return plan
    largest = random.choice((0.005, 0.04, 0.3, 5.0))
    hosts = tuple(
        HostError(
            offset=round(random.uniform(-largest, largest) * SECOND),
            drift=random.choice((0.0, 5e-4, -5e-4, 1e-4)),
        )
        for _ in plan.roles
    )
    return replace(plan, hosts=hosts)


def _preempted(plan: Plan, random: Random) -> Plan:
    return replace(
        plan,
        preempted=random.choice((0.02, 0.2)),
        interruption=random.choice((MILLISECOND, 20 * MILLISECOND, 200 * MILLISECOND)),
    )


def _foreign(plan: Plan, random: Random) -> Plan:
    return plan if plan.launched else replace(plan, foreign=random.choice(plan.names))


def _full_disk(plan: Plan, random: Random) -> Plan:
    return replace(
        plan,
        full_at=random.randrange(1, 40),
        full_for=random.choice((1, 4, FOREVER)),
        disk_error=random.choice((28, 5)),
    )


CHANGES: tuple[Callable[[Plan, Random], Plan], ...] = (
    _network(loss_ratio=(0.001, 0.3)),
    _network(duplicate_ratio=(0.01, 0.5)),
    _network(reorder_ratio=(0.01, 0.5)),
    _network(query_loss_ratio=(0.01, 0.7)),
    _network(delay=(0.001, 0.3), jitter=(0.0, 0.1)),
    _network(lease=(0.3, 2.0)),
    _network(retry=(0.05, 2.0)),
    _clocks,
    _preempted,
    _full_disk,
    _foreign,
)

# ---- Faults


def _instant(plan: Plan, random: Random) -> int:
    """Instant of a fault: mostly during the run."""
    last = 0.0 if plan.launched else max(at for _, at in plan.starts) / SECOND
    if random.random() < 0.2:
        return round(random.uniform(0.0, last + 1.5) * SECOND)
    return round((last + random.uniform(0.0, plan.duration_s + 3.0)) * SECOND)


def _span(random: Random) -> int:
    return round(random.choice((0.2, 1.0, 3.0, 12.0)) * random.uniform(0.3, 1.2) * SECOND)


def _cut(plan: Plan, random: Random) -> Fault:
    return ("cut", _instant(plan, random), random.choice(plan.roles), _span(random))


def _pause(plan: Plan, random: Random) -> Fault:
    return ("pause", _instant(plan, random), random.choice(plan.roles), _span(random))


def _freeze(plan: Plan, random: Random) -> Fault:
    return ("freeze router", _instant(plan, random), _span(random))


def _restart_router(plan: Plan, random: Random) -> Fault:
    back = None if random.random() < 0.2 else _span(random)
    return ("restart router", _instant(plan, random), back)


def _kill(plan: Plan, random: Random) -> Fault:
    roles = [*plan.roles, *([LAUNCHER, ROUTER] if plan.launched else [])]
    back = None if plan.launched or random.random() < 0.5 else _span(random)
    return ("kill", _instant(plan, random), random.choice(roles), back)


def _stop(plan: Plan, random: Random) -> Fault:
    roles = [*plan.roles, *([LAUNCHER] * 3 if plan.launched else [])]
    return ("stop", _instant(plan, random), random.choice(roles), random.choice((2, 15)))


def _stranger(plan: Plan, random: Random) -> Fault:
    kind = random.choice(("recorder", "namesake", "other seed", "foreign end", "noise"))
    return ("stranger", _instant(plan, random), kind, random.choice(plan.names))


def _live_change(plan: Plan, random: Random) -> Fault:
    kind = random.choice(("cut", "heal", "link", "speed", "stall", "gnss"))
    return ("change", _instant(plan, random), kind, random.choice(plan.names))


FAULTS: tuple[Callable[[Plan, Random], Fault], ...] = (
    _cut,
    _pause,
    _freeze,
    _restart_router,
    _kill,
    _stop,
    _stranger,
    _live_change,
)
