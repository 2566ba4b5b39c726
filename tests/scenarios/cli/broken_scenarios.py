"""Scenario files with one random fault each."""

from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from random import Random
from typing import Any

import tomli_w

from tests.made.scenarios.drawn_scenarios import DrawnScenario, Raw

Text = tuple[bytes, Sequence[str]]
"""A scenario file, and further arguments of the command."""

ODD_VALUES: Sequence[object] = (
    *(float("nan"), float("inf"), float("-inf"), -1e308, 1e308, 5e-324, -1, 0, 2**63, 10**400),
    *(True, "", "a\0b", "\x1b[31mred", "[/]", "é" * 5000, [], [[]], [{}], {}, {"a": {"b": 1}}),
)
ODD_KEYS = ("vehicels", "loss_percent", "", "a b", "ключ", "\x1b[2J", "k" * 5000, "kind", "extends")
ODD_OVERRIDES = (
    *("", "=", "=1", "a", "a.b", ".=1", "links.=1", "links..loss_ratio=0", "name.x=1", "path=1"),
    *("path.segments.99.length_m=1", "path.segments[-1].length_m=1", "link.0=1", "link=[[1]]"),
    *("links.loss_ratio=nan", "seed=1e400", f"seed={'9' * 5000}", f"seed=0x{'f' * 5000}"),
    *("convoy.names=['\x1b[31m']", "[=]", "links.loss_ratio=" + "[" * 3000, "x." * 3000 + "x=1"),
    *(
        "extends='lane_change'",
        "path.file=1",
        "start_at=2026-01-01",
        "start_at=0001-01-01T00:00:00Z",
    ),
)
ODD_FILES = (
    *(
        b"",
        b" \n",
        b"\0" * 100,
        b"\xff\xfe" + "name = 'a'".encode("utf-16-le"),
        b"name = 'caf\xe9'",
    ),
    *(b"x = " + b"[" * 5000, b"a." * 5000 + b"a = 1", b"name = 'a'\nname = 'b'", b"[path", b"= 1"),
    *(
        b"seed = " + b"9" * 5000,
        b"seed = 0x" + b"f" * 5000,
        b'name = "\\u0000"',
        b"[[path]]\n[path]",
    ),
    *(b'extends = "broken.toml"', b'extends = "."', b"extends = 3", b'extends = "a\\u0000b"'),
    *(b'extends = "nobody.toml"', b'extends = "' + b"a" * 5000 + b'"', b"\x89MCAP0\r\n", b"{}"),
    *(b"name = 'a'\r" * 2, b"\xef\xbb\xbf", b"path.kind = 1", b"vehicle = []", b"vehicle.v1 = 3"),
    *(b"[control]\ncontroller = 'os.path'", b"[control]\ncontroller = '..'", b"name = 1979-05-27"),
)
ODD_TRACES = (
    *(
        "",
        "x_m,y_m\n",
        "x_m,y_m\n1,1\n",
        "x_m,y_m\n" + "1,1\n" * 50,
        "x_m,y_m\nnan,1\ninf,2\n",
        "\0\1\2",
    ),
    *(
        "x_m,y_m\n0,0\n1e308,1e308\n",
        "x_m,y_m\n0,0\n1e9,0\n",
        "latitude_deg,longitude_deg\n91,0\n92,0\n",
    ),
    *(
        "x_m,y_m,t_s\n0,0,1\n9,0,0\n",
        "<gpx",
        "<?xml version='1.0'?><gpx/>",
        "$GPGGA,,,\n",
        "a,b\n1,2\n",
    ),
    *(
        'x_m,y_m\n"0,0\n',
        "x_m\n1\n2\n",
        "x_m,y_m,x_m\n1,2,3\n4,5,6\n",
        "x_m,y_m\n0,0\n\x1b[31m,2\n9,9\n",
    ),
    *("x_m,y_m\n" + "0,0\n" * 20 + "30,0\n", "x_m,y_m,speed_mps,t_s\n0,0,-1,0\n50,0,-1,5\n"),
)


def broken(chance: Random, drawn: DrawnScenario) -> Text:
    whole = merged(drawn)
    ways: list[Callable[[Random, Raw], Text]] = [
        odd_value, odd_value, odd_value, odd_key, too_deep, cut_off, recoded, odd_trace, odd_points
    ]  # fmt: skip
    if chance.random() < 0.25:
        return chance.choice(ODD_FILES), []
    if chance.random() < 0.2:
        return tomli_w.dumps(whole).encode(), [f"--set={chance.choice(ODD_OVERRIDES)}"]
    return chance.choice(ways)(chance, whole)


def merged(drawn: DrawnScenario) -> Raw:
    tables = deepcopy(drawn.tables)
    tables.pop("extends", None)
    tables.setdefault("name", "drawn")
    tables.setdefault("path", {"kind": "segments", "segments": [{"length_m": 1000.0}]})
    return dict(tables)


def places(tables: Raw) -> Iterator[tuple[Any, Any]]:
    stack: list[Any] = [tables]
    while stack:
        here = stack.pop()
        for key in here if isinstance(here, dict) else range(len(here)):
            yield here, key
            if isinstance(here[key], dict | list):
                stack.append(here[key])


def odd_value(chance: Random, tables: Raw) -> Text:
    here, key = chance.choice(list(places(tables)))
    here[key] = chance.choice(ODD_VALUES)
    return written(tables), []


def odd_key(chance: Random, tables: Raw) -> Text:
    held = [tables, *(here[key] for here, key in places(tables) if isinstance(here[key], dict))]
    chance.choice(held)[chance.choice(ODD_KEYS)] = chance.choice(ODD_VALUES)
    return written(tables), []


def too_deep(chance: Random, tables: Raw) -> Text:
    depth = chance.choice([21, 100, 5000])
    here, key = chance.choice(list(places(tables)))
    here[key] = 7
    nest = "[" * depth + "]" * depth if chance.random() < 0.5 else "{a=" * depth + "1" + "}" * depth
    return written(tables).replace(b"7", nest.encode(), 1), []


def cut_off(chance: Random, tables: Raw) -> Text:
    whole = written(tables)
    at = chance.randrange(len(whole))
    return (whole[:at] if chance.random() < 0.5 else whole[:at] + whole[at + 1 :]), []


def recoded(chance: Random, tables: Raw) -> Text:
    whole = b"description = 'caf\xc3\xa9'\n" + written(tables)
    text = whole.decode()
    at = chance.randrange(len(whole))
    return chance.choice(
        [
            *(text.encode(name) for name in ("utf-16", "utf-32", "latin-1", "utf-8-sig")),
            *(
                whole[:at] + wrong + whole[at:]
                for wrong in (b"\xff", b"\0", b"\xc3", b"\x1b", b"\r")
            ),
        ]
    ), []


def odd_trace(chance: Random, tables: Raw) -> Text:
    named = ["nobody.csv", ".", "/dev/null", "a\0b", "a" * 5000, "\x1b[31m", "", "odd.csv"]
    tables["path"] = {"kind": "trace", "file": chance.choice([*named, *["odd.csv"] * 12])}
    return written(tables), []


def odd_points(chance: Random, tables: Raw) -> Text:
    count = chance.choice([0, 1, 2, 3, 50])
    east = [chance.choice([0.0, 1.0, 1e9, 1e300, chance.uniform(0, 100)]) for _ in range(count)]
    more: Raw = chance.choice(
        [{}, {"closed": True, "laps": 1000}, {"smoothing_m": 500.0}, {"laps": 2}]
    )
    times = chance.choice([[], [0.0] * count, [float(-k) for k in range(count)], [1.0]])
    tables["path"] = {
        "kind": "points",
        "east_m": east,
        "north_m": east[::-1],
        "time_s": times,
        **more,
    }
    return written(tables), []


def written(tables: Raw) -> bytes:
    return tomli_w.dumps(tables).encode()
