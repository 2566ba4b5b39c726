"""The machine-readable twin of `convoy risk`, and the command that repeats a run of it."""

import json
from dataclasses import asdict, replace
from pathlib import Path

from scenarios.studies.many.risk.estimated import Risk, RiskQuestion

SCHEMA = "convoy.risk/1"
TWIN = "risk.json"
NO_COMMAND = (
    "a branched run is no scenario, so no command repeats it: risk.json has its seed and branches"
)


def command_of(question: RiskQuestion, risk: Risk) -> str:
    """The command that repeats a run that broke the limit; empty if there is none."""
    if not risk.broken:
        return ""
    return replace(question.variant, seed=risk.broken[0]).command


def write_risk(question: RiskQuestion, risk: Risk, out: Path) -> None:
    """Write all figures as JSON into the folder `out`."""
    out.mkdir(parents=True, exist_ok=True)
    figures = asdict(risk) | {"broken": len(risk.broken), "broken_seeds": list(risk.broken)}
    whole = {
        "schema": SCHEMA,
        "scenario": question.variant.name,
        "overrides": list(question.variant.overrides),
        "limit": str(question.limit),
        "measure": question.measure,
        "paths": question.paths if risk.repetitions else None,
        "command": command_of(question, risk) or None,
        **figures,
    }
    (out / TWIN).write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
