"""The files of `convoy bisect`: the picture and its machine-readable twin. Needs matplotlib."""

import json
from dataclasses import asdict
from pathlib import Path

from scenarios.studies.many.boundary.answer import BoundaryAnswer, BoundaryQuestion
from scenarios.studies.many.boundary.picture import draw

SCHEMA = "convoy.bisect/1"
PICTURE, TWIN = "boundary.png", "bisect.json"


def write_answer(question: BoundaryQuestion, answer: BoundaryAnswer, out: Path) -> None:
    """Write the picture and all figures as JSON into the folder `out`."""
    out.mkdir(parents=True, exist_ok=True)
    whole = {
        "schema": SCHEMA,
        "scenario": question.variant.name,
        "overrides": list(question.variant.overrides),
        "key": question.key,
        "limit": str(question.limit),
        "range": [question.low, question.high],
        "to": question.to,
        "share": question.share,
        "seeds": list(range(1, question.seeds + 1)),
        **asdict(answer),
    }
    (out / TWIN).write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
    draw(question, answer, out / PICTURE)
