"""Claims of the paper: statement, answer from the findings, and verdict."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypedDict

from scenarios.studies.paper.experiments import Need, Part, RunKey
from scenarios.studies.paper.findings import Findings, Tally
from vehicles.preview.curve_fit import Trajectory

Judgement = Literal["holds", "undecided", "misprint, harmless", "does not hold", "not checkable"]
JUDGEMENTS: tuple[Judgement, ...] = (
    "holds",
    "undecided",
    "misprint, harmless",
    "does not hold",
    "not checkable",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The reproduced result, and whether the claim holds in the exact run (None: not checkable).

    `reason` explains why the claim does not hold, cannot be checked, or holds under conditions. A
    `misprint` does not hold as printed, and no other claim of the paper depends on it.
    `phases` counts the exact runs in which it holds, on shifted roads; `noise` counts the noisy
    runs. `numbers` go into report.json, with units in the keys.
    """

    ours: str
    holds: bool | None
    misprint: bool = False
    reason: str = ""
    phases: Tally | None = None
    noise: Tally | None = None
    numbers: Mapping[str, Any] = field(default_factory=dict)


Answering = Callable[[Findings], Answer]


class ByRuns(TypedDict):
    """Fields of an answer that are evaluated over runs."""

    holds: bool
    phases: Tally | None
    noise: Tally | None


def by_runs(findings: Findings, holds: Callable[..., bool], *keys: RunKey) -> ByRuns:
    """Evaluate `holds` on the exact, shifted and noisy runs of `keys`."""
    return {
        "holds": holds(*(findings.trials[key] for key in keys)),
        "phases": findings.phases(holds, *keys),
        "noise": findings.seeds(holds, *keys),
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """A statement of the paper, the results it needs, and the function that answers it.

    A `simulated` claim is answered for each trajectory; other claims are calculated once.
    """

    name: str
    where: str
    paper: str
    needs: tuple[Need, ...] = ()
    simulated: bool = True
    answer: Answering


class Claims(list[Claim]):
    """The claims of one part of the paper, in order of registration."""

    def claim(
        self, *, where: str, paper: str, needs: tuple[Need, ...] = (), simulated: bool = True
    ) -> Callable[[Answering], Answering]:
        """Register the decorated function as the answer to a claim of the same name."""

        def register(answer: Answering) -> Answering:
            name = answer.__name__
            claim = Claim(
                name=name, where=where, paper=paper, needs=needs, simulated=simulated, answer=answer
            )
            self.append(claim)
            return answer

        return register

    def calculated(
        self, *, where: str, paper: str, need: Need = Part.GAINS
    ) -> Callable[[Answering], Answering]:
        """Register a claim that is calculated, not simulated."""
        return self.claim(where=where, paper=paper, needs=(need,), simulated=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClaimVerdict:
    answer: Answer
    judgement: Judgement


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedClaim:
    claim: Claim
    verdicts: Mapping[Trajectory, ClaimVerdict]

    @property
    def differs(self) -> bool:
        return len({verdict.judgement for verdict in self.verdicts.values()}) > 1


def judge(claims: Iterable[Claim], findings: Mapping[Trajectory, Findings]) -> list[JudgedClaim]:
    return [
        JudgedClaim(claim=claim, verdicts=_verdicts(claim, findings))
        for claim in claims
        if all(results.has(need) for results in findings.values() for need in claim.needs)
    ]


def _verdicts(
    claim: Claim, findings: Mapping[Trajectory, Findings]
) -> dict[Trajectory, ClaimVerdict]:
    if claim.simulated:
        return {
            trajectory: verdict_of(claim.answer(results))
            for trajectory, results in findings.items()
        }
    once = verdict_of(claim.answer(next(iter(findings.values()))))
    return dict.fromkeys(findings, once)


def verdict_of(answer: Answer) -> ClaimVerdict:
    """Judge one answer: a claim that holds in only some of its exact runs is undecided."""
    phases = answer.phases
    judgement: Judgement
    if answer.holds is None:
        judgement = "not checkable"
    elif phases is not None and 0 < phases.holding < phases.runs:
        judgement = "undecided"
    elif answer.misprint and not answer.holds:
        judgement = "misprint, harmless"
    else:
        judgement = "holds" if answer.holds else "does not hold"
    return ClaimVerdict(answer=answer, judgement=judgement)


def counts_text(claims: Sequence[JudgedClaim], trajectory: Trajectory) -> str:
    judgements = [claim.verdicts[trajectory].judgement for claim in claims]
    hold, undecided, misprints, fail, unknown = map(judgements.count, JUDGEMENTS)
    return (
        f"{hold} hold, {undecided} undecided, {misprints} harmless misprints, {fail} do not hold, "
        f"{unknown} cannot be checked"
    )


def groups(claims: Iterable[JudgedClaim], trajectory: Trajectory) -> dict[str, list[JudgedClaim]]:
    """Group claims that do not hold, are misprinted or undecided, and that noise affects."""
    grouped: dict[str, list[JudgedClaim]] = {
        group: []
        for group in (
            "does not hold",
            "misprint, harmless",
            "undecided",
            "fails in noise",
            "holds in noise",
        )
    }
    for claim in claims:
        outcome = claim.verdicts[trajectory]
        if outcome.judgement in grouped:
            grouped[outcome.judgement].append(claim)
        noise = outcome.answer.noise
        if noise is None:
            continue
        if outcome.judgement == "holds" and noise.holding < noise.runs:
            grouped["fails in noise"].append(claim)
        if outcome.judgement == "does not hold" and noise.holding > 0:
            grouped["holds in noise"].append(claim)
    return grouped
