"""What a scenario file may say of how followers degrade when messages fail."""

from typing import Literal

from pydantic import Field

from scenarios.definition.schema.table import Ratio, Table


class DegradationTable(Table):
    """When a source is late, lost and found again, and how the car slows down for it.

    reaction     "degrade": slow down while the road is known, and stop; or one of the baselines to
                 compare with, all at full speed: "extrapolate" the last trajectory, "hold" the last
                 steering command, "straight": wheels straight
    late_periods, lost_periods, lost_s
                 a source is late after so many expected periods without a message, lost after so
                 many or so long, whichever is longer (openpilot: 10 periods)
    trusted_share_ratio, probation_s, probation_s_max, forgiven_after_s
                 it is relied on again once so much of what it usually delivers came over its
                 probation, which doubles with each relapse and halves after each such time without
    gate_deviations, heading_gate_deviations
                 what lies further from what is expected is not believed (PX4's EKF2: 5 and 2.6)
    predecessor_path
                 what is followed of the vehicle ahead while the lead is lost: "meant", the lead's
                 path, by how far off it that vehicle says it is; "driven", the way that it drove
    comfortable, firm, hardest
                 ways of braking: comfortable and firm are Autoware's comfortable and emergency
                 stop; the hardest is for a stop that would otherwise end beyond the known road
    """

    reaction: Literal["degrade", "extrapolate", "hold", "straight"] = "degrade"
    late_periods: float = Field(default=3.0, ge=1, le=1000)
    lost_periods: float = Field(default=10.0, ge=1, le=1000)
    lost_s: float = Field(default=0.5, ge=0.01, le=60)
    trusted_share_ratio: Ratio = 0.9
    probation_s: float = Field(default=1.0, ge=0.1, le=60)
    probation_s_max: float = Field(default=16.0, ge=0.1, le=600)
    forgiven_after_s: float = Field(default=10.0, ge=0.1, le=3600)
    gate_deviations: float = Field(default=5.0, ge=1, le=1000)
    heading_gate_deviations: float = Field(default=3.0, ge=1, le=1000)
    predecessor_path: Literal["meant", "driven"] = "meant"
    comfortable_mps2: float = Field(default=1.0, ge=0.1, le=12)
    comfortable_jerk_mps3: float = Field(default=0.3, ge=0.05, le=100)
    firm_mps2: float = Field(default=2.5, ge=0.1, le=12)
    firm_jerk_mps3: float = Field(default=1.5, ge=0.05, le=100)
    hardest_mps2: float = Field(default=6.0, ge=0.1, le=12)
    hardest_jerk_mps3: float = Field(default=12.0, ge=0.05, le=1000)
