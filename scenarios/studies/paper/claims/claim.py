"""Claims of the paper: what it says, how it is answered from the findings, and the judgement."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from scenarios.studies.paper.findings import Findings, Tally
from scenarios.studies.paper.keys import Need
from vehicles.preview.curve_fit import Trajectory

Judgement = Literal["holds", "undecided", "does not hold", "not checkable"]
JUDGEMENTS: tuple[Judgement, ...] = ("holds", "undecided", "does not hold", "not checkable")


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The result here, and whether the claim holds; None if this cannot be checked.

    `holds` is of the exact run. `reason` is why it does not hold, or cannot be checked, or under
    which conditions it holds. `phases` says in how many exact runs it holds, with the road moved a
    little from one to the next, and `noise` in how many runs with a receiver's noise. `numbers` are
    for machines, units in the keys.
    """

    ours: str
    holds: bool | None
    reason: str = ""
    phases: Tally | None = None
    noise: Tally | None = None
    numbers: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """A statement of the paper and how to answer it, once all results that it `needs` exist.

    What is `driven` is answered for each trajectory, anything else is calculated once.
    """

    name: str
    where: str
    paper: str
    needs: tuple[Need, ...] = ()
    driven: bool = True
    answer: Callable[[Findings], Answer]


class Claims(list[Claim]):
    """The claims of one part of the paper, in the order in which they are registered."""

    def claim(
        self, *, where: str, paper: str, needs: tuple[Need, ...] = (), driven: bool = True
    ) -> Callable[[Callable[[Findings], Answer]], Callable[[Findings], Answer]]:
        """Register the decorated function as the answer to a claim; it gives the claim its name."""

        def register(answer: Callable[[Findings], Answer]) -> Callable[[Findings], Answer]:
            name = answer.__name__
            self.append(
                Claim(
                    name=name, where=where, paper=paper, needs=needs, driven=driven, answer=answer
                )
            )
            return answer

        return register


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """An answer and the judgement on it."""

    answer: Answer
    judgement: Judgement


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedClaim:
    """A claim as it was judged along each trajectory: one row of the report."""

    claim: Claim
    judged: Mapping[Trajectory, Judged]

    @property
    def differs(self) -> bool:
        """Whether the judgement hangs on the trajectory."""
        return len({one.judgement for one in self.judged.values()}) > 1


def judge(claims: Iterable[Claim], findings: Mapping[Trajectory, Findings]) -> list[JudgedClaim]:
    """Judge the claims for which every result that they need exists, along each trajectory."""
    return [
        JudgedClaim(claim=claim, judged=_judged(claim, findings))
        for claim in claims
        if all(one.has(need) for one in findings.values() for need in claim.needs)
    ]


def _judged(claim: Claim, findings: Mapping[Trajectory, Findings]) -> dict[Trajectory, Judged]:
    if claim.driven:
        return {trajectory: judged(claim.answer(one)) for trajectory, one in findings.items()}
    once = judged(claim.answer(next(iter(findings.values()))))
    return dict.fromkeys(findings, once)


def judged(answer: Answer) -> Judged:
    """One rule for all: what holds in all exact runs holds, and in only some is undecided."""
    holding = answer.phases
    judgement: Judgement
    if answer.holds is None:
        judgement = "not checkable"
    elif holding is not None and 0 < holding.holding < holding.runs:
        judgement = "undecided"
    else:
        judgement = "holds" if answer.holds else "does not hold"
    return Judged(answer=answer, judgement=judgement)


def groups(claims: Iterable[JudgedClaim], trajectory: Trajectory) -> dict[str, list[JudgedClaim]]:
    """Group the claims that do not hold or are undecided, and those that noise changes."""
    found: dict[str, list[JudgedClaim]] = {
        group: [] for group in ("does not hold", "undecided", "noise spoils", "noise helps")
    }
    for claim in claims:
        one = claim.judged[trajectory]
        if one.judgement in found:
            found[one.judgement].append(claim)
        noise = one.answer.noise
        if noise is None:
            continue
        if one.judgement == "holds" and noise.holding < noise.runs:
            found["noise spoils"].append(claim)
        if one.judgement == "does not hold" and noise.holding > 0:
            found["noise helps"].append(claim)
    return found
