"""Claims of Section V-D, the field experiment, and how errors propagate in the real convoy."""

import numpy as np

from scenarios.claims import Answer, Question
from scenarios.drives import Array, Trial
from scenarios.experiments import LANE
from scenarios.findings import SAME, Findings, cm, in_cm
from scenarios.weaving import PREVIEW_S, SHORT_PREVIEW_S
from vehicles.parameters import LINCOLN_MKZ
from vehicles.steering import NOMINAL_GAINS
from vehicles.string_stability import propagation, trace_propagation

SETTLED = 10.0
"""Time (s) after which the initial errors are forgotten: the slowest root takes 0.4 s at 25 m/s."""

CAR_WIDTH = 1.86


def settled(trial: Trial) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Largest tracking and true cross-track errors (m) of the followers from SETTLED on."""
    return (
        tuple(_later(drive.at, drive.lateral_error) for drive in trial.followers),
        tuple(_later(drive.at, drive.cross_track) for drive in trial.followers),
    )


def _later(at: Array, values: Array) -> float:
    return float(np.abs(values[at[: len(values)] >= SETTLED]).max())


def _growth(trial: Trial) -> float:
    true = settled(trial)[1]
    return true[-1] / true[0]


def _field(findings: Findings) -> tuple[Trial, Trial]:
    if findings.field is None:
        raise ValueError("the field experiment was not run")
    return findings.field.with_lead_data, findings.field.without_lead_data


def _amplified(findings: Findings) -> Answer:
    _, trial = _field(findings)
    tracking, true = settled(trial)
    return Answer(
        ours=f"after the initial errors PL2, PL3 come {in_cm(true)} off the lead's driven path; "
        f"against the own trajectory {in_cm(tracking)}",
        holds=true[-1] > true[0] + SAME,
        noise=findings.seeds(
            "field/without", lambda t: settled(t)[1][-1] > settled(t)[1][0] + SAME
        ),
        numbers={"tracking_error_m_max": tracking, "cross_track_error_m_max": true},
    )


def _not_amplified(findings: Findings) -> Answer:
    trial, without = _field(findings)
    tracking, true = settled(trial)
    return Answer(
        ours=f"against the own trajectory {in_cm(tracking)}",
        holds=tracking[-1] < tracking[0] + SAME,
        reason=f"true errors still grow, {in_cm(true)}, {_growth(trial):.2f}-fold, but without the "
        f"lead's data {_growth(without):.2f}-fold",
        noise=findings.seeds("field/with", lambda t: settled(t)[0][-1] < settled(t)[0][0] + SAME),
        numbers={"tracking_error_m_max": tracking, "cross_track_error_m_max": true},
    )


def _on_the_road(findings: Findings) -> Answer:
    trial, _ = _field(findings)
    true, room = trial.cross_track, 0.5 * (LANE - CAR_WIDTH)
    return Answer(
        ours=f"from their start on they come {in_cm(true)} off the lead's path; a lane has "
        f"{cm(room)} on each side of a car",
        holds=max(true) < room,
        numbers={"cross_track_error_m_max": true},
    )


def _initial(findings: Findings) -> Answer:
    trial, _ = _field(findings)
    tracking = tuple(drive.tracking_max for drive in trial.followers)
    return Answer(
        ours=f"with PL2 starting 40 cm to the left: {in_cm(tracking)}, later "
        f"{in_cm(settled(trial)[0])}",
        holds=tracking[-1] > tracking[0],
        reason="PL3 follows PL2 back to the lead's path in the first seconds, and no longer after",
        numbers={"tracking_error_m_max": tracking},
    )


def _not_known(_: Findings) -> Answer:
    return Answer(
        ours="an oval with bends of 200 m and a double lane change; errors of some centimetres",
        holds=None,
        reason="neither the course, nor the initial errors, nor any number is in the text",
    )


def _measured(findings: Findings) -> Answer:
    frequencies, ratios = findings.ratios(PREVIEW_S)
    paper = np.abs(propagation(LINCOLN_MKZ, NOMINAL_GAINS, 30.0).at(frequencies))
    trace = np.abs(trace_propagation(LINCOLN_MKZ, NOMINAL_GAINS, 30.0).at(frequencies))
    swings, short = findings.ratios(SHORT_PREVIEW_S)
    expected = np.abs(trace_propagation(LINCOLN_MKZ, NOMINAL_GAINS, 30.0).at(swings))
    apart = float(np.abs(short / expected[:, None] - 1.0)[swings <= 7.0].max())
    mean = ratios.prod(axis=1) ** (1.0 / ratios.shape[1])
    best = int(mean.argmax())
    over = float(frequencies[mean > 1.0].max(initial=0.0))
    return Answer(
        ours=f"in the convoy a swing of the lead grows by up to {100 * (mean[best] - 1):.1f} % "
        f"from car to car (at {frequencies[best]:g} rad/s), at all frequencies tried up to "
        f"{over:g} rad/s, and fades above; |G| says {100 * (paper[best] - 1):.0f} %",
        holds=bool((mean[frequencies <= 2.5] > 1.0).all()),
        reason="G steers by the difference of both cars' states at one instant. In the convoy a "
        "car follows the path that the other left, with feedforward (F), and fits it over 32 m, "
        "which smooths away what is shorter: with a preview of 0.2 instead of 0.8 s the ratios "
        f"follow F within {100 * apart:.0f} % up to 7 rad/s",
        numbers={
            "frequency_radps": frequencies.tolist(),
            "measured_ratio": ratios.tolist(),
            "g_ratio": paper.tolist(),
            "f_ratio": trace.tolist(),
            "short_preview_frequency_radps": swings.tolist(),
            "short_preview_measured_ratio": short.tolist(),
        },
    )


FIELD: tuple[Question, ...] = (
    Question(
        name="propagation_measured",
        where="IV-B, on the real convoy",
        paper="Errors amplify at low frequencies with the predecessor's data only",
        needs=("propagation",),
        answer=_measured,
    ),
    Question(
        name="field_course",
        where="V-D, reference path and errors",
        paper="The figures of the path and of the lateral errors",
        needs=("field",),
        answer=_not_known,
    ),
    Question(
        name="field_amplified",
        where="V-D.1, without lead data",
        paper="Cross-track errors amplify from PL2 to PL3",
        needs=("field",),
        answer=_amplified,
    ),
    Question(
        name="field_not_amplified",
        where="V-D.2, with lead data",
        paper="Cross-track errors of the followers do not amplify",
        needs=("field",),
        answer=_not_amplified,
    ),
    Question(
        name="field_initial_error",
        where="V-D.2, with lead data",
        paper="Where they appear to, it is for the second car's initial error",
        needs=("field",),
        answer=_initial,
    ),
    Question(
        name="field_on_the_road",
        where="V-D.2",
        paper="All followers stay on the road throughout",
        needs=("field",),
        answer=_on_the_road,
    ),
)
