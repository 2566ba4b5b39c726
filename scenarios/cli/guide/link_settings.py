"""The configuration of each link and the predicted figures, as text."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from rich.console import Console
from rich.markup import escape

from scenarios.cli.columns import grid_of
from scenarios.definition.check.false_alarms import SAMPLED
from scenarios.definition.check.link_forecast import LinkForecast, ReceiverForecast

UNKNOWN = "not predictable"
Row = tuple[str, str]


def print_links(
    name: str,
    links: Sequence[LinkForecast],
    receivers: Sequence[ReceiverForecast],
    console: Console,
) -> None:
    """Print a block for each group of equal links, and how often receivers lose all sources."""
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
    if receivers:
        console.print(
            f"\n[bold]expected losses of all sources{_by_chance(links)}[/]", highlight=False
        )
    together: dict[str, list[str]] = {}
    for receiver in receivers:
        together.setdefault(_often(receiver.all_lost_per_h), []).append(receiver.receiver)
    for often, names in together.items():
        console.print(f"  {', '.join(names)}: {often}", highlight=False, markup=False)


def _often(per_h: float | None) -> str:
    if per_h is None:
        return UNKNOWN
    if not per_h:
        return f"never in a sample of {SAMPLED} messages"
    return f"{per_h:.0f} per hour" if per_h >= 100.0 else f"{per_h:.2g} per hour"


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
    yield "silences", f"expected{_by_chance([link])}: {_often(link.false_alarms_per_h)}"


def _by_chance(links: Sequence[LinkForecast]) -> str:
    """Name the length and the cause of the silences that a forecast counts."""
    lengths = sorted({link.silence_s_max for link in links})
    length = " to ".join(
        f"{silence_s:.3g}" for silence_s in dict.fromkeys((lengths[0], lengths[-1]))
    )
    return f" > {length} s (random loss and delay only)"


def _burst(link: LinkForecast) -> str:
    if link.loss_ratio in {0.0, 1.0}:
        return ""
    if link.burst_messages_mean is None:
        return ", in bursts of unpredictable length"
    return f", bursts of {link.burst_messages_mean:.4g} messages on average"
