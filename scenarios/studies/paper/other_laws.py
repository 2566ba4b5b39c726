"""Additional claims: other steering laws on the same composite trajectories, base case."""

from functools import partial

from scenarios.results.drives import Trial
from scenarios.studies.paper.base_case import numbers_of
from scenarios.studies.paper.claim import Answer, Claim, Claims, by_runs
from scenarios.studies.paper.experiments import BASE, OTHER_LAWS, Variant
from scenarios.studies.paper.findings import TOLERANCE_M, Findings, in_cm, non_increasing

NAMES = {
    "stanley": "Stanley's law (Hoffmann et al., 2007)",
    "pure_pursuit": "pure pursuit (Coulter, 1992; Snider, 2009)",
}

CLAIMS = Claims()


def compare_with(law: Variant, findings: Findings) -> Answer:
    """Answer whether the paper's law has no larger tracking errors than `law`."""
    own, other = findings.trials[BASE], findings.trials[BASE.with_variant(law)]
    word = "decrease" if non_increasing(other.tracking) else "do not decrease"
    return Answer(
        **by_runs(findings, _is_at_least_as_close, BASE, BASE.with_variant(law)),
        ours=f"{law.replace('_', ' ')}: tracking errors {in_cm(other.tracking)}, which {word}; "
        f"true errors {in_cm(other.cross_track)}. The paper's law: tracking errors "
        f"{in_cm(own.tracking)}; true errors {in_cm(own.cross_track)}",
        numbers=numbers_of(other),
    )


def _is_at_least_as_close(own: Trial, other: Trial) -> bool:
    return max(own.tracking) <= max(other.tracking) + TOLERANCE_M


for _law in OTHER_LAWS:
    CLAIMS.append(
        Claim(
            name=f"against_{_law}",
            where="not in the paper",
            paper=f"The paper's law has no larger tracking errors than {NAMES[_law]}",
            needs=(BASE, BASE.with_variant(_law)),
            answer=partial(compare_with, _law),
        )
    )
