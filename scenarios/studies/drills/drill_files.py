"""Files of drills: JSON, and JUnit XML for test servers."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

from scenarios.studies.drills.drill import DrillResult, DrillRow
from scenarios.studies.engine.results import write_files

SCHEMA = "convoy.drills/1"
JSON_FILE = "drills.json"


def machine_readable(rows: Sequence[DrillRow], runs: Sequence[DrillResult]) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "passed": all(row.passed for row in rows),
        "rows": [asdict(row) for row in rows],
        "runs": [
            {key: value for key, value in asdict(run).items() if key != "duration_s"}
            for run in runs
        ],
    }


def write_junit(rows: Sequence[DrillRow], runs: Sequence[DrillResult], file: Path) -> None:
    """Write all rows as JUnit XML: a test suite per drill, a test case per limit."""
    root = as_xml(rows, runs)
    Xml.indent(root)
    text = Xml.tostring(root, encoding="unicode")
    write_files(file.parent, {file.name: f"<?xml version='1.0' encoding='utf-8'?>\n{text}"})


def as_xml(rows: Sequence[DrillRow], runs: Sequence[DrillResult]) -> Xml.Element:
    """Return all rows as an XML tree.

    The time of a suite is the sum over its runs, that of a case is its run's. Unknown times of
    cases are omitted.
    """
    failed = sum(not row.passed for row in rows)
    took = sum(run.duration_s for run in runs)
    root = Xml.Element("testsuites", _counts("convoy drill", len(rows), failed, took))
    for name in dict.fromkeys(row.drill for row in rows):
        own = [row for row in rows if row.drill == name]
        took = sum(run.duration_s for run in runs if run.drill == name)
        failed = sum(not row.passed for row in own)
        suite = Xml.SubElement(root, "testsuite", _counts(name, len(own), failed, took))
        for row in own:
            its_runs = (run for run in runs if (run.drill, run.seed) == (name, row.seed))
            _case(suite, row, next((run.duration_s for run in its_runs), 0.0))
    return root


def _counts(name: str, tests: int, failures: int, duration_s: float) -> dict[str, str]:
    return {
        "name": name,
        "tests": str(tests),
        "failures": str(failures),
        "errors": "0",
        "time": f"{duration_s:.3f}",
    }


def _case(suite: Xml.Element, row: DrillRow, duration_s: float) -> None:
    case = Xml.SubElement(suite, "testcase", {"classname": row.drill, "name": row.label})
    if duration_s > 0.0:
        case.set("time", f"{duration_s:.3f}")
    if not row.passed:
        failure = Xml.SubElement(case, "failure", {"type": "limit", "message": row.message})
        failure.text = f"{row.message}\nrepeat: {row.command}"
    facts = [] if row.value is None else [f"value {row.value:.6g}"]
    if row.margin_ratio is not None:
        facts.append(f"margin {row.margin_ratio:.3f} of the bound")
    Xml.SubElement(case, "system-out").text = ", ".join((*facts, f"seed {row.seed}"))
