"""Scenario files: read, refused in clear lines, or resolved to all that a run needs."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from scenarios.refusal import ScenarioError, near, refusals
from scenarios.schema import (
    GnssTable,
    LoadingTable,
    OriginTable,
    ParametersTable,
    ScenarioTables,
    SteeringTable,
    Table,
)
from scenarios.toml_text import OverrideError, Raw, override, parse_override, to_toml
from transport.link import LinkRule
from vehicles.geodesy import Origin
from vehicles.parameters import LINCOLN_MKZ, Loading, VehicleParameters, loaded

DEFAULT_GAP = 15.0
"""Metres between centres of mass where a scenario says nothing (paper, Section V)."""

AnyTable = TypeVar("AnyTable", bound=Table)


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleSetup:
    """One vehicle of a scenario: `place` counts from the lead, which is 0.

    `parameters` are those of the loaded car; `assumed_parameters` are what its controller and
    estimator reckon with, without the load unless the scenario says that they know it. `hears`
    are the vehicles whose poses it uses: lead and predecessor, nobody for the lead itself.
    """

    name: str
    place: int
    lead: str
    predecessor: str | None
    hears: tuple[str, ...]
    gap_m: float
    lateral_offset_m: float
    heading_offset_rad: float
    parameters: VehicleParameters
    assumed_parameters: VehicleParameters
    steering: SteeringTable
    gnss: GnssTable


@dataclass(frozen=True)
class Scenario:
    """A valid scenario with every default and trace filled in; `tables` holds all its keys."""

    tables: ScenarioTables

    @property
    def name(self) -> str:
        """Name of the scenario, for folders and titles."""
        return self.tables.name

    @property
    def seed(self) -> int:
        """Seed of all that is random in the run."""
        return self.tables.seed

    @property
    def duration_s(self) -> float:
        """How long the run lasts."""
        if self.tables.duration_s is None:
            raise ScenarioError(["duration_s: missing"])
        return self.tables.duration_s

    @property
    def start_at_ns(self) -> int:
        """Unix time at which a virtual run starts; a wall-clock run starts when it starts."""
        start = self.tables.start_at
        return int(start.timestamp()) * 1_000_000_000 + start.microsecond * 1000

    @property
    def control_rate_hz(self) -> float:
        """Rate at which every vehicle decides."""
        return self.tables.control.rate_hz

    @cached_property
    def vehicle_names(self) -> tuple[str, ...]:
        """Names in order, the lead first."""
        return vehicle_names(self.tables)

    @property
    def lead(self) -> str:
        """Name of the first vehicle."""
        return self.vehicle_names[0]

    @property
    def origin(self) -> Origin:
        """Where the plane touches the earth."""
        table = self.tables.origin or OriginTable()
        return Origin(table.latitude_deg, table.longitude_deg, table.altitude_m)

    def vehicle(self, name: str) -> VehicleSetup:
        """All about the vehicle called `name`; raises ScenarioError if there is none."""
        names = self.vehicle_names
        if name not in names:
            known = ", ".join(names)
            raise ScenarioError([f"{self.name}: no vehicle {name!r}, there are {known}"])
        place = names.index(name)
        tables, own = self.tables, self.tables.vehicle.get(name)
        predecessor = names[place - 1] if place else None
        control = overlay(tables.control, own and own.control)
        empty = car(overlay(tables.parameters, own and own.parameters))
        full = loaded(empty, load(overlay(tables.loading, own and own.loading)))
        return VehicleSetup(
            name=name,
            place=place,
            lead=self.lead,
            predecessor=predecessor,
            hears=tuple(dict.fromkeys(names[:1] + names[place - 1 : place])) if place else (),
            gap_m=gaps(tables)[place],
            lateral_offset_m=own.lateral_offset_m if own else 0.0,
            heading_offset_rad=math.radians(own.heading_offset_deg) if own else 0.0,
            parameters=full,
            assumed_parameters=full if control.knows_loading else empty,
            steering=control,
            gnss=overlay(tables.gnss, own and own.gnss),
        )

    def links_into(self, receiver: str) -> Mapping[str, LinkRule]:
        """Return the link from each vehicle that `receiver` hears."""
        found = {}
        for sender in self.vehicle(receiver).hears:
            link = self.tables.links
            for entry in self.tables.link:
                if entry.sender in {sender, "*"} and entry.receiver in {receiver, "*"}:
                    link = overlay(link, entry)
            found[sender] = LinkRule(**link.model_dump())
        return found

    @property
    def text(self) -> str:
        """The scenario as one self-contained TOML file, which `scenario_from_text` reads back."""
        tables = self.tables
        whole = tables.model_dump(exclude_none=True, exclude={"link", "vehicle"})
        # What one link or vehicle leaves out must stay left out: it is the convoy's value.
        some = tables.model_dump(exclude_unset=True, include={"link", "vehicle"})
        return to_toml(whole | some)


def overlay(base: AnyTable, own: Table | None) -> AnyTable:
    """Return `base` with every key that was written in `own`, table by table."""
    if own is None:
        return base
    fields = type(base).model_fields
    changes = {key: getattr(own, key) for key in own.model_fields_set if key in fields}
    for key, value in changes.items():
        if isinstance(value, Table):
            changes[key] = overlay(getattr(base, key), value)
    return base.model_copy(update=changes)


def car(table: ParametersTable) -> VehicleParameters:
    """Return the empty car: the paper's, with the keys that the scenario gives."""
    changes = {
        key.removesuffix(f"_{unit}"): value
        for key, value in table.model_dump(exclude_none=True).items()
        for unit in ("kg", "kgm2", "n_per_rad", "m", "radps", "ratio", "rad")
        if key.removesuffix(f"_{unit}") in VehicleParameters.__dataclass_fields__
    }
    return replace(LINCOLN_MKZ, **changes)


def load(table: LoadingTable) -> Loading:
    """Return passengers and luggage."""
    return Loading(
        front_passengers=table.front_passengers,
        rear_passengers=table.rear_passengers,
        passenger_mass=table.passenger_mass_kg,
        luggage_mass=table.luggage_mass_kg,
        luggage_offset=table.luggage_offset_m,
    )


def vehicle_names(tables: ScenarioTables) -> tuple[str, ...]:
    """Names given, or v1, v2, ..."""
    convoy = tables.convoy
    return convoy.names or tuple(f"v{place}" for place in range(1, convoy.vehicles + 1))


def gaps(tables: ScenarioTables) -> list[float]:
    """Return the gap at the start from each vehicle to the one ahead (m); 0 for the lead."""
    convoy = DEFAULT_GAP if tables.convoy.gap_m is None else tables.convoy.gap_m
    own = [tables.vehicle.get(name) for name in vehicle_names(tables)]
    found = [table.gap_m if table and table.gap_m is not None else convoy for table in own]
    return [0.0, *found[1:]]


def library() -> tuple[str, ...]:
    """Names of the scenarios that ship."""
    entries = (Path(entry.name) for entry in files("scenarios").joinpath("library").iterdir())
    return tuple(sorted(e.stem for e in entries if e.suffix == ".toml" and e.stem[0] != "_"))


def load_scenario(
    name_or_path: str | Path, overrides: Sequence[str] = (), seed: int | None = None
) -> Scenario:
    """Read a shipped scenario by its name, or a file; `overrides` are `key.path=value` in TOML.

    Raises ScenarioError, whose lines each name file, key, what was given and what is allowed.
    """
    label, folder, text = _read(name_or_path)
    return scenario_from_text(text, label=label, folder=folder, overrides=overrides, seed=seed)


def scenario_from_text(
    text: str,
    *,
    label: str = "scenario",
    folder: Path | None = None,
    overrides: Sequence[str] = (),
    seed: int | None = None,
) -> Scenario:
    """Read a scenario from text; `label` names it in refusals, traces are sought in `folder`."""
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError([f"{label}: not valid TOML: {error}"]) from error
    changed = _apply(raw, overrides)
    if seed is not None:
        raw["seed"] = seed
    try:
        tables = ScenarioTables.model_validate(raw)
    except ValidationError as error:
        lines = (f"{_blame(key, label, changed)}: {key}: {why}" for key, why in refusals(error))
        raise ScenarioError(lines) from error
    return Scenario(tables)


def _apply(raw: Raw, overrides: Sequence[str]) -> list[str]:
    changed = []
    for text in overrides:
        try:
            parts, value = parse_override(text)
            override(raw, parts, value)
        except OverrideError as error:
            raise ScenarioError([f"--set {text}: {error}"]) from error
        changed.append(".".join(parts))
    return changed


def _blame(key: str, label: str, changed: Sequence[str]) -> str:
    plain = key.replace("[", ".").replace("]", "")
    return "--set" if any(plain.startswith(one) for one in changed) else label


def _read(name_or_path: str | Path) -> tuple[str, Path, str]:
    path = Path(name_or_path)
    if str(name_or_path) in library():
        path = Path(str(files("scenarios"))) / "library" / f"{name_or_path}.toml"
    label = path.name if path.parent == Path() else str(path)
    try:
        text = path.read_bytes().decode()
    except FileNotFoundError as error:
        raise ScenarioError([f"{name_or_path}: {_not_found(path)}"]) from error
    except OSError as error:
        raise ScenarioError([f"{label}: {(error.strerror or 'cannot be read').lower()}"]) from error
    except UnicodeDecodeError as error:
        raise ScenarioError(
            [f"{label}: not a text file (byte {error.start} is not UTF-8)"]
        ) from error
    if not text.strip():
        raise ScenarioError([f"{label}: empty file; `convoy new` writes a commented scenario"])
    return label, path.parent, text


def _not_found(path: Path) -> str:
    beside = [entry.name for entry in path.parent.glob("*.toml")] if path.parent.is_dir() else []
    guess = near(str(path), library()) or near(path.name, beside)
    return f"no such file{guess or '; shipped scenarios are ' + ', '.join(library())}"
