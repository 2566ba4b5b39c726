"""The configuration of each link and the predicted figures, as text."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from rich.console import Console
from rich.markup import escape

from scenarios.cli.columns import grid_of
from scenarios.definition.check.link_forecast import LinkForecast

UNKNOWN = "not predictable"
Row = tuple[str, str]


def print_links(name: str, links: Sequence[LinkForecast], console: Console) -> None:
    """Print a block for each group of equal links."""
    console.print(f"[bold]{escape(name)}: links[/]", highlight=False)
    if not links:
        console.print("none: no vehicle receives")
    alike: dict[LinkForecast, list[LinkForecast]] = {}
    for link in links:
        alike.setdefault(replace(link, sender="", receiver=""), []).append(link)
    for link, group in alike.items():
        named = ", ".join(f"{alike_link.sender} → {alike_link.receiver}" for alike_link in group)
        console.print(f"\n[bold]{escape(named)}[/]", highlight=False)
        console.print(grid_of((f"  {name}", text) for name, text in _rows(link)))


def _rows(link: LinkForecast) -> Iterator[Row]:
    first, *further = ("[links]" if rule == "links" else rule for rule in link.rules)
    yield "settings from", first + (f", over {', '.join(further)}" if further else "")
    if link.preset is not None:
        yield "preset", link.preset
        yield "source", link.preset_source or "not stated"
    for place, law in enumerate(link.laws):
        yield "laws" if not place else "", f"{law.words} · {law.key}"
    at = "" if link.distance_m is None else f" at {link.distance_m:.3g} m, as far as at the start"
    if link.loss_ratio is None:
        yield "loss", UNKNOWN
    else:
        yield "loss", f"{100.0 * link.loss_ratio:.4g} %{at}{_burst(link)}"
    if link.latency_ms_mean is None or link.latency_ms_deviation is None:
        yield "delay", UNKNOWN
    else:
        yield "delay", f"{link.latency_ms_mean:.4g} ± {link.latency_ms_deviation:.4g} ms"
    age = UNKNOWN if link.age_ms_mean is None else f"{link.age_ms_mean:.4g} ms on average"
    yield (
        "age",
        f"of the newest message at a command: {age}, at a sending rate of {link.rate_hz:.3g} Hz",
    )


def _burst(link: LinkForecast) -> str:
    if link.loss_ratio in {0.0, 1.0}:
        return ""
    if link.burst_messages_mean is None:
        return ", in bursts of unpredictable length"
    return f", bursts of {link.burst_messages_mean:.4g} messages on average"
