"""Three logs: of this version, of an earlier one, and a damaged one."""

from pathlib import Path

import pytest

import scenarios.api as convoy

GENERATION_1 = Path(__file__).parents[2] / "golden/logs/generation_1/run.mcap"
SETTINGS = {
    "duration_s": 4.0,
    "links.loss_ratio": 0.3,
    "links.latency_ms": 60.0,
    "change": [{"kind": "cut", "at_s": 1.0, "for_s": 0.5}],
}


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("logs")
    log = convoy.run(set=SETTINGS, out=folder / "run").log
    damaged = folder / "damaged.mcap"
    data = bytearray(log.read_bytes())
    data[len(data) // 2] ^= 1
    damaged.write_bytes(data)
    return {"new": log, "earlier version": GENERATION_1, "damaged": damaged}
