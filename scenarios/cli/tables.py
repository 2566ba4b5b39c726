"""The figures of a run as tables for a person; `summary.json` holds the same for machines."""

from pathlib import Path
from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from scenarios.definition.check.report import CheckReport
from scenarios.results.summary import RunSummary

if TYPE_CHECKING:  # brings scipy, which a run does without
    from scenarios.studies.gains.results import GainsReport


def print_summary(summary: RunSummary, log: Path | None, console: Console) -> None:
    """Print a table per vehicle, a table per link and where the log is."""
    console.print(vehicle_table(summary))
    if summary.links:
        console.print(link_table(summary))
    if summary.reason:
        console.print(f"[bold red]ended early:[/] {escape(summary.reason)}", highlight=False)
    if log is not None:
        console.print(f"log: {log}", highlight=False, markup=False, emoji=False, soft_wrap=True)


def vehicle_table(summary: RunSummary) -> Table:
    """One row per vehicle: errors against its trajectory and off the lead's path, and counts."""
    title = (
        f"{summary.identity.scenario}, {summary.identity.clock} clock, seed {summary.identity.seed}"
    )
    table = Table(title=f"{title}, {summary.ran_s:.1f} s", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("vehicle", no_wrap=True)
    for heading in (
        "error cm\nmax / rms",
        "off path cm\nmax / rms",
        "gap m\nmin",
        "poses\nlogged",
        "lost",
        "late\nticks",
        "re-\nfused",
        "MB",
        "CPU\n%",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in summary.vehicles:
        table.add_row(
            row.name,
            _pair_cm(row.lateral_error_m_max, row.lateral_error_m_rms),
            _pair_cm(row.cross_track_error_m_max, row.cross_track_error_m_rms),
            "-" if row.gap_m_min is None else f"{row.gap_m_min:.1f}",
            str(row.poses),
            str(row.missing_poses),
            str(row.late_ticks),
            str(row.rejected_messages),
            f"{row.memory_bytes_max / 1e6:.0f}" if row.memory_bytes_max else "",
            f"{row.cpu_ratio * 100:.1f}" if row.memory_bytes_max else "",
        )
    return table


def link_table(summary: RunSummary) -> Table:
    """One row per directed link, requested against achieved."""
    table = Table(title="links, requested / achieved", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("link", no_wrap=True)
    for heading in ("loss, %", "latency, ms", "sent", "heard", "dropped", "late"):
        table.add_column(heading, justify="right")
    for row in summary.links:
        asked = row.requested
        jitter = f"+{asked.jitter_ms:g}" if asked.jitter_ms else ""
        dropped = ", ".join(f"{count} {reason}" for reason, count in row.dropped.items())
        table.add_row(
            f"{row.sender} → {row.receiver}",
            f"{asked.loss_ratio * 100:g} / {row.loss_ratio * 100:.1f}",
            f"{asked.latency_ms:g}{jitter} / {row.latency_ms_mean:.1f}",
            str(row.sent),
            str(row.heard),
            dropped or "0",
            str(row.late),
        )
    return table


def _pair_cm(largest: float | None, rms: float | None) -> str:
    return "-" if largest is None or rms is None else f"{largest * 100:.1f} / {rms * 100:.1f}"


def check_table(report: CheckReport) -> Table:
    """What a scenario asks for, one figure a row."""
    title = f"{report.name}: {escape(report.description)}"
    table = Table(title=title, box=SIMPLE_HEAD, show_header=False)
    table.add_column("what", no_wrap=True)
    table.add_column("figure")
    rows = (
        ("vehicles", ", ".join(report.vehicles)),
        ("gaps at the start", ", ".join(f"{gap:g}" for gap in report.gaps_m) + " m"),
        ("duration", f"{report.duration_s:.1f} s"),
        ("path, and driven of it", f"{report.path_length_m:.0f} m, {report.driven_m:.0f} m"),
        ("tightest radius", f"{report.radius_m_min:.1f} m" if report.radius_m_min else "straight"),
        ("speed", f"{report.speed_mps_min:.1f} to {report.speed_mps_max:.1f} m/s"),
        (
            "acceleration, braking",
            f"{report.acceleration_mps2_max:.1f}, {report.braking_mps2_max:.1f} m/s²",
        ),
        ("lateral acceleration", f"{report.lateral_acceleration_mps2_max:.1f} m/s²"),
    )
    for what, figure in rows:
        if figure != " m":  # a vehicle alone has no gaps
            table.add_row(what, figure)
    table.add_row("seed", str(report.seed))
    distinct: dict[str, list[str]] = {}
    for name, link in report.links.items():
        rate = "every message" if link["rate_hz"] is None else f"{link['rate_hz']:g} Hz"
        asked = f"{link['latency_ms']:g} ms, jitter {link['jitter_ms']:g} ms, "
        asked += f"loss {link['loss_ratio']:g}, {rate}"
        distinct.setdefault(asked, []).append(name)
    for asked, names in distinct.items():
        table.add_row("links", f"{asked}: {', '.join(names)}")
    if report.deviation_m_rms is not None and report.deviation_m_max is not None:
        rms, largest = report.deviation_m_rms * 100, report.deviation_m_max * 100
        table.add_row("path off the recorded points", f"{rms:.1f} cm rms, {largest:.1f} cm at most")
    return table


def gains_table(report: "GainsReport") -> Table:
    """Margins, propagation and certificate of a set of gains, one speed a row."""
    at_all = report.stabilising_set.inside_at_all_speeds_and_loadings
    title = (
        f"gains {', '.join(f'{value:g}' for value in report.gains)} "
        f"{'stabilise' if at_all else 'do NOT stabilise'} all speeds and loadings"
    )
    table = Table(title=title, box=SIMPLE_HEAD, min_width=len(title))  # on one line
    for heading in (
        "speed\nm/s",
        "slowest pole\n1/s",
        "to the\nboundary",
        "predecessor only\npeak |G|, rad/s",
    ):
        table.add_column(heading, justify="right")
    for row, passed_on in zip(report.speeds, report.propagation, strict=True):
        peak = passed_on.second_order
        table.add_row(
            f"{row.speed_mps:.1f}",
            f"{row.abscissa_per_s:.2f}",
            f"{row.ball_radius:.3f}",
            f"{peak.norm_ratio:.3f} @ {peak.peak_radps:.2f}" if peak else "unstable",
        )
    return table
