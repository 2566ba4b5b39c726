"""The figures of a run as tables for a person; `summary.json` holds the same for machines."""

from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table


def print_summary(summary: dict[str, Any], log: Path | None, console: Console) -> None:
    """Print a table per vehicle, a table per link and where the log is."""
    console.print(vehicle_table(summary))
    if summary["links"]:
        console.print(link_table(summary))
    if summary["reason"]:
        console.print(f"[bold red]ended early:[/] {summary['reason']}", highlight=False)
    if log is not None:
        console.print(f"log: {log}", highlight=False, soft_wrap=True)


def vehicle_table(summary: dict[str, Any]) -> Table:
    """One row per vehicle: errors against its trajectory and off the lead's path, and counts."""
    title = f"{summary['scenario']}, {summary['clock']} clock, seed {summary['seed']}"
    table = Table(title=f"{title}, {summary['ran_s']:.1f} s", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
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
    for row in summary["vehicles"]:
        table.add_row(
            row["name"],
            _pair_cm(row["lateral_error_m_max"], row["lateral_error_m_rms"]),
            _pair_cm(row["cross_track_error_m_max"], row["cross_track_error_m_rms"]),
            "" if row["gap_m_min"] is None else f"{row['gap_m_min']:.1f}",
            str(row["poses"]),
            str(row["missing_poses"]),
            str(row["late_ticks"]),
            str(row["rejected_messages"]),
            f"{row['memory_bytes_max'] / 1e6:.0f}" if row["memory_bytes_max"] else "",
            f"{row['cpu_ratio'] * 100:.1f}" if row["memory_bytes_max"] else "",
        )
    return table


def link_table(summary: dict[str, Any]) -> Table:
    """One row per directed link, requested against achieved."""
    table = Table(title="links, requested / achieved", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("link", no_wrap=True)
    for heading in ("loss, %", "latency, ms", "sent", "heard", "dropped", "late"):
        table.add_column(heading, justify="right")
    for row in summary["links"]:
        asked = row["requested"]
        jitter = f"+{asked['jitter_ms']:g}" if asked["jitter_ms"] else ""
        dropped = ", ".join(f"{count} {reason}" for reason, count in row["dropped"].items())
        table.add_row(
            f"{row['sender']} → {row['receiver']}",
            f"{asked['loss_ratio'] * 100:g} / {row['loss_ratio'] * 100:.1f}",
            f"{asked['latency_ms']:g}{jitter} / {row['latency_ms_mean']:.1f}",
            str(row["sent"]),
            str(row["heard"]),
            dropped or "0",
            str(row["late"]),
        )
    return table


def _pair_cm(largest: float | None, rms: float | None) -> str:
    return "" if largest is None or rms is None else f"{largest * 100:.1f} / {rms * 100:.1f}"
