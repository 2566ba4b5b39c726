"""What `convoy blame` leaves behind: figures as JSON, and the smallest set as a scenario."""

import json
import shlex
from pathlib import Path
from typing import Any

from scenarios.definition.scenario import Scenario
from scenarios.studies.many.blame.losses import Burst
from scenarios.studies.many.blame.ranking import ALONE, NEGLIGIBLE_M, Blamed
from scenarios.studies.many.blame.rerun import BlameAnswer
from scenarios.studies.many.blame.study import Blame
from vehicles.schedule import SECOND

SCHEMA = "convoy.blame/1"
PICTURE, TWIN, SMALLEST = "blame.png", "blame.json", "smallest.toml"
GROUPING = (
    "a burst is a run of consecutive numbers lost on one link; bursts that overlap in time are a "
    "moment; moments in order of time were given back half by half, and only halves that mend "
    f"{NEGLIGIBLE_M:g} m or more, or mend it only together, were looked into"
)


def smallest_scenario(found: Blame) -> Scenario | None:
    """The scenario that loses the smallest set and nothing else, and fails by the limit."""
    if found.smallest is None:
        return None
    lines = ", ".join(burst.line for burst in found.smallest.bursts)
    count, seed = len(found.smallest.messages), found.run.scenario.seed
    description = f"{found.run.scenario.name}, seed {seed}: {count} messages lost, {lines}"
    return found.convoy.smallest(
        found.smallest.messages, found.question.limit, shortened(description)
    )


def shortened(text: str, most: int = 200) -> str:
    """A text cut where it is longer."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def command_of(out: Path) -> str:
    """The command that shows the smallest set break the limit."""
    return shlex.join(["convoy", "run", str(out / SMALLEST), "--clock", "virtual"])


def write_files(found: Blame, out: Path) -> list[Path]:
    """Write the JSON, and the scenario where there is a smallest set; returns their paths."""
    out.mkdir(parents=True, exist_ok=True)
    written = [out / TWIN]
    scenario = smallest_scenario(found)
    if scenario is not None:
        head = f"# Written by `convoy blame {shlex.quote(str(found.run.log))}`: it breaks "
        rest = f"# {found.question.limit} with no other losses than those listed below.\n#\n"
        path = out / SMALLEST
        path.write_text(
            f"{head}the limit\n{rest}#   {command_of(out)}\n\n{scenario.text}", encoding="utf-8"
        )
        written.append(path)
    text = json.dumps(machine_readable(found, out), indent=1, ensure_ascii=False)
    (out / TWIN).write_text(f"{text}\n", encoding="utf-8")
    return written


def machine_readable(found: Blame, out: Path) -> dict[str, Any]:
    """Give all that was found as JSON has it."""
    run = found.run
    lost = [one for burst in found.bursts for one in burst.messages]
    return {
        "schema": SCHEMA,
        "log": str(run.log),
        "scenario": run.scenario.name,
        "seed": run.scenario.seed,
        "limit": str(found.question.limit),
        "figure": found.question.figure,
        "until_s": found.question.until / SECOND,
        "recorded": _answer(found.recorded),
        "without_loss": _answer(found.clean),
        "considered_messages": len(lost),
        "considered_bursts": len(found.bursts),
        "grouping": GROUPING,
        "lost_alone_rows_max": ALONE,
        "rows": [_row(row) for row in found.rows],
        "smallest": _smallest(found, out),
        "unshrunk": found.unshrunk,
        "runs": found.runs,
    }


def _answer(answer: BlameAnswer) -> dict[str, Any]:
    broken = answer.broken_at
    return {
        "figure_m": answer.figure_m,
        "vehicle": answer.vehicle,
        "worst_at_s": answer.worst_at / SECOND,
        "broken_at_s": None if broken is None else broken / SECOND,
    }


def _burst(burst: Burst) -> dict[str, Any]:
    (sender, receiver), (from_s, to_s) = burst.link, burst.span_s
    return {
        "sender": sender,
        "receiver": receiver,
        "numbers": list(burst.numbers),
        "from_s": from_s,
        "to_s": to_s,
        "messages": len(burst.messages),
    }


def _row(row: Blamed) -> dict[str, Any]:
    return {
        "kind": row.kind,
        "messages": row.messages,
        "mended_m": row.mended_m,
        "alone": None if row.alone is None else _answer(row.alone),
        "bursts": [_burst(burst) for burst in row.group],
    }


def _smallest(found: Blame, out: Path) -> dict[str, Any] | None:
    if found.smallest is None or found.smallest_answer is None:
        return None
    return {
        "file": SMALLEST,
        "command": command_of(out),
        "messages": len(found.smallest.messages),
        "is_minimal": found.smallest.is_minimal,
        "bursts": [_burst(burst) for burst in found.smallest.bursts],
        **_answer(found.smallest_answer),
    }
