"""Reference page about string stability."""

from collections.abc import Mapping

from scenarios.cli.reference.printing import print_section, print_text
from scenarios.results.recorded.frequency_gains import LEAST_COHERENCE, LEAST_RMS
from scenarios.results.vehicles.string_figures import (
    LEAST_ACCELERATION_MPS2,
    LEAST_ERROR_M,
    SIGMAS,
)


def string_stability_page() -> None:
    print_text(
        "String stability: whether errors grow from vehicle to vehicle. The figures are in "
        "vehicles[].string of summary.json, in `convoy report`, in `run.string_errors` of Python, "
        "and by name in `sweep --metric`, such as v6.string.spacing_gain_l2_from_first. Limits on "
        "them are in `convoy reference limits`."
    )
    for heading, (text, rows) in SECTIONS.items():
        print_section(heading, rows.items(), text)


Section = tuple[str, Mapping[str, str]]
SECTIONS: Mapping[str, Section] = {
    "signals": (
        "All vehicles are compared over the same places or times, so that ratios of root mean "
        "squares are ratios of L2 norms, and ratios of largest magnitudes are ratios of L∞ norms.",
        {
            "lateral": "true offset e_i(s) of follower i from the path that the lead drove, at "
            "equal arc length s, over the path that all followers drove. Lead: none.",
            "spacing": "spacing error δ_i(t) of a follower that keeps a gap (speed.followers = "
            '"gap"): arc length to the vehicle ahead along the path of the lead, minus the desired '
            "one, speed.gap.standstill_m + headway_s · own speed. Positive if the gap is too wide. "
            "Lead: none.",
            "acceleration": "true longitudinal acceleration a_i(t), also of the lead.",
        },
    ),
    "gains": (
        "Each is a norm of the output over the same norm of the input, for L2 and for L∞.",
        {
            "*_gain_l2, *_gain_linf": "output: signal of vehicle i; input: the same signal of the "
            "vehicle ahead, i - 1. The first follower has one of the acceleration only.",
            "*_from_first": "output: lateral or spacing error of vehicle i; input: that of the "
            "first follower. Of the last vehicle it is the head-to-tail gain.",
            "*_from_lead": "output: acceleration of vehicle i; input: acceleration of the lead, "
            "the disturbance. Of the last vehicle it is the head-to-tail gain.",
            "v3 over v2": "v2 follows the lead, whose speed control announces its acceleration one "
            "control period earlier than a follower's law. With laws that use it, such as Ploeg's, "
            "the spacing error of v2 is smaller for that reason, and the first gain is large.",
            "*_growth_l2": "geometric mean of the gains per vehicle from the head to vehicle i: "
            "the gain from the head to the power of 1 / number of vehicles between.",
        },
    ),
    "definitions": (
        "A run shows the response to its disturbance, not the supremum over all of them: a gain "
        "above 1 refutes string stability in that sense, gains below 1 do not prove it.",
        {
            "Swaroop and Hedrick": "(1996): all spacing errors stay bounded, and converge, for "
            "small initial errors. Errors that do not grow along the string, gains ≤ 1 in L∞, are "
            "sufficient.",
            "Ploeg et al.": "(2014): L_p string stability: the norm of every vehicle's output is "
            "bounded by the lead's input, whatever the length. Strict: gain from vehicle to "
            "vehicle at most 1, here *_gain_l2 or *_gain_linf. Semi-strict: gain from the first "
            "vehicle to each other one at most 1, here *_from_first and *_from_lead.",
            "Feng et al.": "(2019), a survey: weak string stability is the gain from head to tail, "
            "strong (strict) string stability that of every pair. A string may amplify between two "
            "vehicles and still attenuate from head to tail.",
        },
    ),
    "no figure": (
        "A gain is left out where its input is at the level of the noise: the ratio would compare "
        "noise with noise.",
        {
            "lateral": "root mean square of the input (L2) below σ, or largest value (L∞) below "
            f"{SIGMAS:g} σ, where σ is the larger of the receiver's stated and the vehicle's "
            f"estimated standard deviation of the position of the vehicle ahead, at its worst, and "
            f"at least {LEAST_ERROR_M * 1000:g} mm; no gain if neither is recorded",
            "spacing": "the same with √2 σ, since two positions are measured",
            "acceleration": f"root mean square below {LEAST_ACCELERATION_MPS2:g} m/s², or largest "
            f"value below {SIGMAS * LEAST_ACCELERATION_MPS2:g} m/s²",
            "all": "less than 40 m or 0.4 s in common, such as behind a vehicle that failed early",
        },
    ),
    "gains by frequency": (
        "`run.frequency_gains()` in Python and a picture of `convoy report --html`: gain and phase "
        "from the speed (or spacing error) of the vehicle ahead to that of a vehicle, from the "
        "cross spectrum over the spectrum of the input (H1), averaged over five Fourier "
        "coefficients of the whole run, whose last fifth is faded out; a run that does not begin "
        "at constant speed, such as a part of a log, has a Hann window. A pulse that has faded by "
        "the end of a run from constant speed on, and a steady oscillation, are exact up to noise; "
        "the interval has a confidence of 95 % (Bendat and Piersol, Random Data).",
        {
            "excitation": "the input has a root mean square of at least "
            f"{LEAST_RMS['speed']:g} m/s² (spacing: {LEAST_RMS['spacing'] * 100:g} cm), and the "
            "band 1 % of the power of the strongest one; else nothing is given",
            "coherence": f"at least {LEAST_COHERENCE:g}; else nothing is given",
        },
    ),
    "growth over seeds": (
        "`convoy sweep --metric v6.string.spacing_growth_l2` prints the geometric mean over the "
        "seeds with its 95 % interval; `convoy diff` compares two folders of runs.",
        {},
    ),
    "alpha*": (
        "The lateral law of the paper has another answer: with a weight α of the predecessor and "
        "1 - α of the lead, errors are not amplified at any frequency if α < α* = 1/‖G‖∞, where G "
        "is the transfer of the lateral error from vehicle to vehicle with the predecessor alone. "
        "`convoy check` prints α* at the scenario's speed; `convoy gains` and `convoy reproduce` "
        "have its source.",
        {},
    ),
}
