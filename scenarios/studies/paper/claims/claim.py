"""Claims of the paper as questions to the findings: what it says, what we get, whether it holds."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from scenarios.studies.paper.findings import Findings, Tally

Verdict = Literal["holds", "undecided", "does not hold", "not checkable"]
VERDICTS: tuple[Verdict, ...] = ("holds", "undecided", "does not hold", "not checkable")


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What we get, and whether the claim holds; None says that this cannot be checked.

    `reason` is why it does not hold, or cannot be checked, or holds only so far. `phases` says in
    how many exact runs it holds, the road moved a little from one to the next, and `noise` in how
    many with a receiver's noise. `numbers` are for machines, units in the keys.
    """

    ours: str
    holds: bool | None
    reason: str = ""
    phases: Tally | None = None
    noise: Tally | None = None
    numbers: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """A claim and how to answer it, once all results that it `needs` are there."""

    name: str
    where: str
    paper: str
    needs: tuple[str, ...] = ()
    answer: Callable[[Findings], Answer]


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """A claim with its verdict: one row of the report."""

    name: str
    where: str
    paper: str
    ours: str
    verdict: Verdict
    reason: str
    phases: Tally | None
    noise: Tally | None
    numbers: Mapping[str, Any]


def judge(questions: Iterable[Question], findings: Findings) -> list[Claim]:
    """Answer the questions for which everything was run."""
    return [
        _claim(question, question.answer(findings))
        for question in questions
        if all(map(findings.has, question.needs))
    ]


def _claim(question: Question, answer: Answer) -> Claim:
    verdict: Verdict = "not checkable"
    if answer.phases is not None and 0 < answer.phases.holding < answer.phases.runs:
        verdict = "undecided"
    elif answer.holds is not None:
        verdict = "holds" if answer.holds else "does not hold"
    return Claim(
        name=question.name,
        where=question.where,
        paper=question.paper,
        ours=answer.ours,
        verdict=verdict,
        reason=answer.reason,
        phases=answer.phases,
        noise=answer.noise,
        numbers=answer.numbers,
    )


def sides(claims: Iterable[Claim]) -> dict[str, list[Claim]]:
    """Sort out the claims that do not hold or are undecided, and those on which noise has a say.

    `noise spoils`: holds exactly, but not with every seed; `noise helps`: the other way round.
    """
    found: dict[str, list[Claim]] = {
        side: [] for side in ("does not hold", "undecided", "noise spoils", "noise helps")
    }
    for claim in claims:
        if claim.verdict in found:
            found[claim.verdict].append(claim)
        if claim.noise is None:
            continue
        if claim.verdict == "holds" and claim.noise.holding < claim.noise.runs:
            found["noise spoils"].append(claim)
        if claim.verdict == "does not hold" and claim.noise.holding > 0:
            found["noise helps"].append(claim)
    return found
