"""The table of `convoy check`: configuration and predicted figures."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import TypeAdapter
from rich.console import Console
from rich.text import Text

from scenarios.cli.columns import grid_of
from scenarios.definition.check.findings import CheckReport
from scenarios.definition.schema.gnss_table import GnssTable
from scenarios.definition.schema.scenario_tables import SendingTable

Row = tuple[str, str]
"""Name and value."""


def print_report(report: CheckReport, console: Console) -> None:
    title = f"{report.name}: {report.description}" if report.description else report.name
    console.print(Text(title, style="bold"), highlight=False)
    parts = (_convoy, _road, _drivers, _links, _ends)
    console.print(grid_of(row for part in parts for row in part(report)))


def _convoy(report: CheckReport) -> Iterator[Row]:
    yield "vehicles", ", ".join(report.vehicles)
    if report.gaps_m:  # more than one vehicle
        yield "gaps at the start", ", ".join(f"{gap:.4g}" for gap in report.gaps_m) + " m"
    for name, offset in report.offsets.items():
        turn = f"turned {offset['heading_offset_deg']:g}°"
        yield "start off the path", f"{name}: {offset['lateral_offset_m']:g} m left, {turn}"
    for name, replay in report.replays.items():
        begun = f"from its time {replay['begun_s']:.1f} s, by {replay['clock']} times"
        off = f"path {100.0 * replay['deviation_m_max']:.1f} cm off its points at most"
        yield "replayed", f"{name}: {replay['file']}, {begun}, {off}"
    yield "duration, seed", f"{report.duration_s:.1f} s, {report.seed}"


def _road(report: CheckReport) -> Iterator[Row]:
    yield "length of the path", f"{report.path_length_m:.0f} m"
    yield "distance driven", f"{report.driven_m:.0f} m"
    yield "tightest radius", f"{report.radius_m_min:.1f} m" if report.radius_m_min else "straight"
    if report.deviation_m_rms is not None and report.deviation_m_max is not None:
        rms, largest = report.deviation_m_rms * 100, report.deviation_m_max * 100
        figures = f"{rms:.1f} cm rms, {largest:.1f} cm max"
        yield "deviation of the path", f"{figures} from the recorded points"
        yield from _drive(report)
    speeds = f"{report.speed_mps_min:.1f} to {report.speed_mps_max:.1f} m/s"
    yield "speed of the lead", f"{speeds} ({report.lead_speed})"
    forward, braking = report.acceleration_mps2_max, report.braking_mps2_max
    lateral = f"lateral up to {report.lateral_acceleration_mps2_max:.1f} m/s²"
    changes = f"up to {forward:.1f} m/s², braking up to {braking:.1f} m/s², {lateral}"
    yield "acceleration of the lead", changes
    if len(report.vehicles) > 1:
        yield "followers drive", _followers(report.gap_policy)


def _drive(report: CheckReport) -> Iterator[Row]:
    size = "1 hole of" if report.holes == 1 else f"{report.holes} holes up to"
    holes = f", {size} {report.hole_m_max:.1f} m" if report.holes else ""
    noise = f"noise {100.0 * (report.noise_m or 0.0):.1f} cm"
    yield "recorded points", f"{report.points}, {noise}{holes}"
    yield "smoothing", f"{report.smoothing_m:g} m half width"
    left_out = {
        ("unusable", "unusable"): report.skipped_lines,
        ("jump", "jumps"): report.jumping_points,
        ("standing", "standing"): report.standing_points,
    }
    if any(left_out.values()):
        counts = (f"{count} {names[count != 1]}" for names, count in left_out.items() if count)
        yield "points left out", ", ".join(counts)
    if any(report.coordinates_offset_m or ()):
        east, north = report.coordinates_offset_m or (0.0, 0.0)
        yield "coordinates offset", f"{east:.0f} m east, {north:.0f} m north"


def _followers(gap: Mapping[str, float] | None) -> str:
    if gap is None:
        return "the lead's speed at the same time"
    policy = f"a gap of {gap['standstill_m']:g} m + {gap['headway_s']:g} s · speed"
    limits = (
        f"up to {gap['acceleration_mps2_max']:g}, braking up to {gap['braking_mps2_max']:g} m/s²"
    )
    return f"{policy}; acceleration {limits}"


def _drivers(report: CheckReport) -> Iterator[Row]:
    followers = dict(list(report.control.items())[1:])
    yield "control", f"at {report.control_rate_hz:g} Hz"
    yield from _grouped_rows("controller", report.control, _controller)
    if report.gap_policy is not None:
        yield from _grouped_rows("longitudinal law", followers, _longitudinal)
    yield from _grouped_rows("information flow", report.information_flow, _flow)
    yield from _grouped_rows("fusion", followers, _fusion)
    limits = {name: report.control[name] | limit for name, limit in report.largest_alpha.items()}
    yield from _grouped_rows("largest α", limits, _largest_alpha)
    yield from _grouped_rows("GNSS", report.gnss, _receiver)
    yield from _grouped_rows("sending", report.sending, _sending)
    yield from _grouped_rows("own state", report.imu, _own_state)
    yield from _grouped_rows("gap sensor", report.gap_sensor, _gap_sensor, all_named=True)
    yield from _grouped_rows("tyres", report.tyres, _tyres)
    yield from _grouped_rows(
        "mass", report.masses_kg, lambda mass: f"{mass:g} kg with driver and load"
    )


def _controller(settings: Mapping[str, Any]) -> str:
    gains = ", ".join(f"{gain:g}" for gain in settings["gains"].values())
    load = "learns" if settings["estimate_slip"] else "does not know"
    load = "knows" if settings["knows_loading"] else load
    return f"{plug_in_text(settings['controller'])}, gains {gains}, {load} the load"


def _longitudinal(settings: Mapping[str, Any]) -> str:
    return plug_in_text(settings["longitudinal"])


def plug_in_text(given: str | Mapping[str, Any]) -> str:
    if isinstance(given, str):
        return given
    parameters = [f"{key} {value}" for key, value in given.items() if key != "use"]
    return f"{given['use']} ({', '.join(parameters)})"


def _tyres(settings: Mapping[str, Any]) -> str:
    brush = f"brush, friction {settings['friction_ratio']:g}"
    rate = settings["steering_rate_limit_radps"]
    wheels = (
        "no limit of the steering rate" if rate is None else f"steering rate up to {rate:g} rad/s"
    )
    return f"{brush if settings['tyres'] == 'brush' else 'linear'}; {wheels}"


def _fusion(settings: Mapping[str, Any]) -> str:
    sight = f"preview {settings['preview_s']:g} s, tolerance {settings['tolerance_m']:g} m"
    how = f"{settings['trajectory']} trajectory"
    return f"{plug_in_text(settings['fusion'])}, {how}, α {settings['alpha_ratio']:g}, {sight}"


def _flow(settings: Mapping[str, Any]) -> str:
    """Describe the sources, once if they are those of both directions."""
    lateral, longitudinal = settings["lateral"], settings["longitudinal"]
    if lateral == longitudinal:
        return str(lateral)
    return f"lateral {lateral}; longitudinal {longitudinal}"


def _largest_alpha(limit: Mapping[str, Any]) -> str:
    """Describe alpha* = 1 / ||G||_inf, and on which side of it a vehicle is."""
    alpha, largest = limit["alpha_ratio"], limit["largest_alpha_ratio"]
    at = f"{limit['frequency_radps']:.1f} rad/s"
    if alpha < largest:
        meaning = f"α {alpha:g} is below it: errors fade from car to car at every frequency"
    else:
        meaning = f"α {alpha:g} is above it: errors at {at} may grow from car to car"
    return f"{largest:.4f} at {limit['speed_mps']:.1f} m/s, 1/‖G‖∞ with actuation ({at}). {meaning}"


def _receiver(settings: Mapping[str, Any]) -> str:
    return "; ".join(GnssTable.model_validate(settings).value.describe())


def _sending(settings: Mapping[str, Any]) -> str:
    rule = TypeAdapter[SendingTable](SendingTable).validate_python(settings).value
    return f"{rule.describe()}; congestion control" if rule.dcc else rule.describe()


def _own_state(settings: Mapping[str, float] | None) -> str:
    if settings is None:
        return "exact"
    return (
        f"estimated from GNSS and an inertial sensor at {settings['rate_hz']:g} Hz, noise "
        f"{settings['speed_noise_mps']:g} m/s, {settings['yaw_rate_noise_radps']:g} rad/s, bias "
        f"{settings['speed_bias_mps']:g} m/s, {settings['yaw_rate_bias_radps']:g} rad/s"
    )


def _gap_sensor(settings: Mapping[str, float]) -> str:
    return (
        f"up to {settings['range_m']:g} m within {settings['field_of_view_deg']:g}°, "
        f"{settings['rate_hz']:g} Hz, latency {settings['latency_ms']:g} ms, noise "
        f"{settings['gap_noise_m']:g} m, {settings['gap_rate_noise_mps']:g} m/s"
    )


def _links(report: CheckReport) -> Iterator[Row]:
    settings = {name: {**table, "laws": report.laws[name]} for name, table in report.links.items()}
    yield from _grouped_rows("links", settings, _link, all_named=True)


def _link(settings: Mapping[str, Any]) -> str:
    carried = (
        "every message" if settings["rate_hz"] is None else f"up to {settings['rate_hz']:g} Hz"
    )
    delay = f"{settings['latency_ms']:g} ms, jitter {settings['jitter_ms']:g} ms"
    preset = f"{settings['preset']}, " if settings["preset"] else ""
    laws = f"; {settings['laws']}" if settings["laws"] else ""
    return f"{preset}{delay}, loss {settings['loss_ratio']:g}, carries {carried}{laws}"


def _ends(report: CheckReport) -> Iterator[Row]:
    policy = report.on_vehicle_failure.replace("_", " ")
    yield "on vehicle failure", policy if policy != "end" else "the run ends"
    yield "clocks", f"corrected to the recorder's, within {report.clock_uncertainty_ms_max:g} ms"
    events = report.events
    yield "lane", f"{events['lane_width_m']:g} m wide"
    near = f"below {events['near_miss_gap_m']:g} m or {events['near_miss_time_s']:g} s"
    yield "near miss", f"{near} to a collision"
    yield "path lost", f"no known path for {events['path_lost_s']:g} s"
    yield "limits that fail the run", ", ".join(_limits(report.limits)) or "none"


def _limits(settings: Mapping[str, Any]) -> Iterator[str]:
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from (f"{name}.{limit}" for limit in _limits(value))
        elif isinstance(value, list | tuple):
            for one in value:
                what = one.get("mode") or one.get("status") or f"within {one['error_m']:g} m"
                about = f" of {one['source']}" if "source" in one else ""
                span = f"within {one['within_s']:g} s after {one['after_s']:g} s"
                yield f"{one['vehicle']} {what}{about} {span}"
        elif value is not None:
            yield f"{name} = {value}"


def _grouped_rows(
    what: str, settings: Mapping[str, Any], words: Any, *, all_named: bool = False
) -> Iterator[Row]:
    """Yield a row for each distinct setting, with the names of its vehicles.

    A setting that all vehicles share needs no names, unless `all_named`.
    """
    distinct: dict[str, list[str]] = {}
    for name, values in settings.items():
        distinct.setdefault(words(values), []).append(name)
    for text, names in distinct.items():
        named = all_named or len(distinct) > 1
        yield what, f"{text}: {', '.join(names)}" if named else text
