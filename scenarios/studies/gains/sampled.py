"""How often a car has to know itself and to decide, for the loop to be stable as it is run."""

from dataclasses import replace

from scenarios.studies.gains.results import SampledAt, Subject
from vehicles.theory.sampled_loop import SampledLoop, lowest_stable_rate, sampled_stability

USUAL = 50
"""Rate (Hz) of control and of the inertial sensor, from which lower ones are sought."""


def sampled_at(subject: Subject, speed: float) -> SampledAt:
    """Collect the decay at the usual rates, and the lowest rates of each kind, at one speed."""
    usual = SampledLoop(subject.parameters, subject.parameters, subject.gains)

    def inertial(rate: float) -> SampledLoop:
        return replace(usual, imu_hz=rate)

    def with_fixes(rate: float) -> SampledLoop:
        return replace(usual, imu_hz=rate, gnss_hz=rate)

    def deciding(rate: float) -> SampledLoop:
        return replace(usual, imu_hz=rate, control_hz=rate)

    return SampledAt(
        speed_mps=speed,
        decay_per_s=sampled_stability(usual, speed).decay,
        lowest_imu_rate_hz=lowest_stable_rate(inertial, speed, USUAL),
        lowest_rate_without_imu_hz=lowest_stable_rate(with_fixes, speed, USUAL),
        lowest_control_rate_hz=lowest_stable_rate(deciding, speed, USUAL),
    )
