"""Claims of the paper as questions to the findings: what it says, what we get, whether it holds."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from scenarios.findings import Findings, Seeds

Verdict = Literal["holds", "does not hold", "not checkable"]
VERDICTS: tuple[Verdict, ...] = ("holds", "does not hold", "not checkable")


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What we get, and whether the claim holds; None says that this cannot be checked.

    `reason` is why it does not hold, or cannot be checked, or holds only so far. `noise` says in
    how many runs with a receiver's noise it holds. `numbers` are for machines, units in the keys.
    """

    ours: str
    holds: bool | None
    reason: str = ""
    noise: Seeds | None = None
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
    noise: Seeds | None
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
    if answer.holds is not None:
        verdict = "holds" if answer.holds else "does not hold"
    return Claim(
        name=question.name,
        where=question.where,
        paper=question.paper,
        ours=answer.ours,
        verdict=verdict,
        reason=answer.reason,
        noise=answer.noise,
        numbers=answer.numbers,
    )


def sides(claims: Iterable[Claim]) -> dict[str, list[Claim]]:
    """Sort out the claims that do not hold, and those on which noise has a say.

    `noise spoils`: holds exactly, but not with every seed; `noise helps`: the other way round.
    """
    found: dict[str, list[Claim]] = {"does not hold": [], "noise spoils": [], "noise helps": []}
    for claim in claims:
        if claim.verdict == "does not hold":
            found["does not hold"].append(claim)
        if claim.noise is None:
            continue
        if claim.verdict == "holds" and claim.noise.holding < claim.noise.runs:
            found["noise spoils"].append(claim)
        if claim.verdict == "does not hold" and claim.noise.holding > 0:
            found["noise helps"].append(claim)
    return found
