"""Claims of the paper: what it says, how it is answered from the findings, and the judgement."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from scenarios.studies.paper.findings import Findings, Tally
from scenarios.studies.paper.keys import Need

Judgement = Literal["holds", "undecided", "does not hold", "not checkable"]
JUDGEMENTS: tuple[Judgement, ...] = ("holds", "undecided", "does not hold", "not checkable")


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The result here, and whether the claim holds; None if this cannot be checked.

    `reason` is why it does not hold, or cannot be checked, or under which conditions it holds.
    `phases` says in how many exact runs it holds, with the road moved a little from one to the
    next, and `noise` in how many runs with a receiver's noise. `numbers` are for machines, units in
    the keys.
    """

    ours: str
    holds: bool | None
    reason: str = ""
    phases: Tally | None = None
    noise: Tally | None = None
    numbers: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """A statement of the paper and how to answer it, once all results that it `needs` exist."""

    name: str
    where: str
    paper: str
    needs: tuple[Need, ...] = ()
    answer: Callable[[Findings], Answer]


class Claims(list[Claim]):
    """The claims of one part of the paper, in the order in which they are registered."""

    def claim(
        self, *, where: str, paper: str, needs: tuple[Need, ...] = ()
    ) -> Callable[[Callable[[Findings], Answer]], Callable[[Findings], Answer]]:
        """Register the decorated function as the answer to a claim; it gives the claim its name."""

        def register(answer: Callable[[Findings], Answer]) -> Callable[[Findings], Answer]:
            name = answer.__name__
            self.append(Claim(name=name, where=where, paper=paper, needs=needs, answer=answer))
            return answer

        return register


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedClaim:
    """A claim with its answer and the judgement: one row of the report."""

    claim: Claim
    answer: Answer
    judgement: Judgement


def judge(claims: Iterable[Claim], findings: Findings) -> list[JudgedClaim]:
    """Judge the claims for which every result that they need exists."""
    return [
        _judged(claim, claim.answer(findings))
        for claim in claims
        if all(map(findings.has, claim.needs))
    ]


def _judged(claim: Claim, answer: Answer) -> JudgedClaim:
    judgement: Judgement = "not checkable"
    if answer.phases is not None and 0 < answer.phases.holding < answer.phases.runs:
        judgement = "undecided"
    elif answer.holds is not None:
        judgement = "holds" if answer.holds else "does not hold"
    return JudgedClaim(claim=claim, answer=answer, judgement=judgement)


def groups(claims: Iterable[JudgedClaim]) -> dict[str, list[JudgedClaim]]:
    """Group the claims that do not hold or are undecided, and those that noise changes.

    `noise spoils`: holds exactly, but not with every seed; `noise helps`: the other way round.
    """
    found: dict[str, list[JudgedClaim]] = {
        group: [] for group in ("does not hold", "undecided", "noise spoils", "noise helps")
    }
    for one in claims:
        if one.judgement in found:
            found[one.judgement].append(one)
        noise = one.answer.noise
        if noise is None:
            continue
        if one.judgement == "holds" and noise.holding < noise.runs:
            found["noise spoils"].append(one)
        if one.judgement == "does not hold" and noise.holding > 0:
            found["noise helps"].append(one)
    return found
