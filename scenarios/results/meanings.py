"""What the fields of `summary.json` mean, as a table that `convoy reference fields` prints.

Fields are grouped by the list whose entries have them; those of the summary itself are in "".
"""

from collections.abc import Mapping

MEANINGS: Mapping[str, Mapping[str, str]] = {
    "": {
        "schema": "convoy.summary/1",
        "scenario": "its name",
        "title": "name, seed, weight of the predecessor, loss, presets and overrides: what tells"
        " runs apart; behind the name of a scenario that does not ship, a fingerprint of all that"
        " it says",
        "overrides": "what was laid over the file by --set and --seed",
        "seed": "the seed that was used",
        "clock": "wall or virtual",
        "run_id": "the run's folder; in virtual time made of scenario, overrides and seed",
        "python": "version that drove",
        "convoy-emulator": "version that drove",
        "eclipse-zenoh": "version that drove",
        "mcap": "version that drove",
        "numpy": "version that drove",
        "protobuf": "version that drove",
        "pymap3d": "version that drove",
        "outcome": "completed or failed",
        "reason": "why it failed",
        "duration_s": "asked for",
        "ran_s": "driven",
        "recorder_rejected_messages": "what the recorder refused, by reason",
        "warnings": "who refused a hundred messages of whom, or ten times as many, because of their"
        " stamps; whose tyres left their linear range, first when; which links did something else"
        " than was asked; and if more than one tick in a hundred began late",
    },
    "vehicles": {
        "name": "of the vehicle, in the order of the convoy",
        "role": "lead, the first, or follower",
        "poses": "GPS poses in the log",
        "missing_poses": "those of the schedule that are not in the log, until the end or the"
        " vehicle's own; where poses come by no schedule, numbers that are missing between others",
        "silent_from_s": "since when nothing of it was recorded though the run went on: it died,"
        " left, or was not heard; else null",
        "lateral_error_m_max": "largest error against the trajectory it steers along, as it"
        " believes it",
        "lateral_error_m_rms": "the same, root mean square",
        "heading_error_rad_max": "the same for the heading, largest",
        "cross_track_error_m_max": "largest true distance from the path the lead drove, with the"
        " road behind its start; null for the lead",
        "cross_track_error_m_rms": "the same, root mean square",
        "cross_track_error_max_at_s": "when that was largest",
        "believed_minus_true_error_m_max": "largest difference between the error that it believes"
        " and the true one, once it has a trajectory",
        "true_gap_m_min": "smallest true distance between its body and that of the vehicle ahead, 0"
        " in a collision",
        "true_gap_min_at_s": "when that was smallest",
        "gap_m_min": "smallest gap to the vehicle ahead as it believes it, between centres of mass"
        " along the path",
        "distance_m": "distance driven",
        "lateral_acceleration_mps2_max": "largest, across the body, to either side",
        "front_slip_rad_max": "largest slip angle of the front axle, to either side",
        "rear_slip_rad_max": "largest slip angle of the rear axle, to either side",
        "friction_ratio_max": "largest share of the friction that an axle used; linear tyres carry"
        " more than 1",
        "sliding_s": "how long an axle used all of it, or more",
        "ticks_by_mode": "how often it steered along what: composite, one source, coast, ...",
        "reaction": "what it did about messages that did not come: mode_changes, recoveries, how"
        " often it relied on all its sources again, recovery_s_mean and recovery_s_max, how long it"
        " did not, stops, blind_m, how far it drove beyond the road that it knew,"
        " predicted_blind_m_max, the most that it expected of that when it began to stop, hazards,"
        " how often it warned those behind",
        "ticks": "instants of its schedule, for control or GNSS, that it went through",
        "late_ticks": "ticks that began more than half a control period after the vehicle's turn",
        "lateness_ms_max": "the worst of them",
        "rejected_messages": "messages that the vehicle received and refused",
        "memory_bytes_max": "of the process; 0 in virtual time",
        "cpu_ratio": "of the process, of one core on average; 0 in virtual time",
        "finished": "whether its final counters were received",
    },
    "links": {
        "sender": "each link has a direction",
        "receiver": "the vehicle that judges the messages of the link",
        "requested": "what was asked for, by the keys of [links] in a scenario: latency_ms,"
        " jitter_ms, loss_ratio, rate_hz, loss, collisions, radio, delay, queue, outages, content,"
        " preset, preset_source (null: not asked for)",
        "requested_loss_ratio": "the share that should be lost by all laws together; null where no"
        " number says it, as with a loss that depends on the distance",
        "requested_burst_messages": "how many messages in a row should be lost on average",
        "requested_latency_ms_mean": "from sending to reception, of what is delivered",
        "requested_latency_ms_deviation": "standard deviation of it",
        "sent": "messages of the sender",
        "judged": "messages that came to the link",
        "heard": "messages delivered",
        "dropped": "messages dropped, by reason",
        "late": "messages received after the tick that needed them",
        "copies": "messages that the channel delivered once more",
        "false": "messages delivered whose content the channel changed, by kind",
        "reordered": "messages delivered after one with a greater number",
        "loss_ratio": "achieved, of what the link carries",
        "loss_ratio_low": "its interval of 95 %, which allows for bursts",
        "loss_ratio_high": "its other end",
        "burst_messages_mean": "how many messages in a row were lost on average",
        "burst_messages_low": "its interval of 95 %",
        "burst_messages_high": "its other end, null where one burst alone tells nothing",
        "burst_messages_max": "the longest",
        "latency_ms_mean": "achieved, of what was delivered",
        "latency_ms_low": "its interval of 95 %, as if each message were delayed on its own",
        "latency_ms_high": "its other end",
        "latency_ms_deviation": "standard deviation, achieved",
        "latency_ms_p95": "not exceeded by 95 %",
        "latency_ms_max": "achieved",
        "arrival_gap_ms_mean": "time between two instants at which something was delivered",
        "arrival_gap_ms_p95": "not exceeded by 95 %",
        "arrival_gap_ms_max": "the longest",
        "age_ms_mean": "how long ago the newest that was known of the sender had been measured, at"
        " the receiver's steering commands",
        "age_ms_p95": "not exceeded by 95 %",
        "age_ms_max": "the oldest",
        "false_alarms": "how often the receiver counted the sender as lost although it sent:"
        " counted, null where the receiver does not report it; predicted, low and high are null,"
        " except in older summaries",
        "safe_time_ratio": "share of the steering commands with an age of at most so many ms",
    },
    "events": {
        "kind": "collision, near_miss, lane_departure, path_lost, slide, stop, or distrust of a"
        " source",
        "at_s": "when it began",
        "vehicles": "who, in the order of the convoy",
        "figures": "closing_speed_mps; gap_m_min, time_to_collision_s_min; excess_m_max,"
        " duration_s; friction_ratio_max, slip_rad_max, duration_s; known_m, predicted_blind_m,"
        " duration_s",
    },
    "holes": {
        "vehicle": "whose poses were sent and not recorded; all figures are of what was recorded",
        "from_s": "the first of them; without a schedule of sending, the pose before",
        "to_s": "the last of them; or the pose after",
        "poses": "how many",
        "kind": "pose, or true pose where poses were recorded meanwhile",
    },
    "limits": {
        "limit": "its key in [limits] of the scenario",
        "bound": "what was allowed",
        "figure": "what came of it; null where what had to be done by an instant was not",
        "vehicle": "whose figure it is; empty for a count of events",
        "what": "what had to be done by an instant; else empty",
        "line": "how it was broken; empty if it was kept",
    },
}
