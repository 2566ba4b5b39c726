"""HTML and SVG elements as text; everything but markup is escaped."""

from html import escape


class Markup(str):
    """Text that is markup already."""

    __slots__ = ()


def element(tag: str, /, *content: "str | None", **attributes: object) -> Markup:
    """Make an element; None is left out, as are attributes that are None.

    Names of attributes: a trailing underscore is dropped, others become hyphens.
    """
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(str(value))}"'
        for key, value in attributes.items()
        if value is not None
    )
    inside = join(*content)
    if not content and tag in {"path", "line", "rect", "circle", "meta"}:
        return Markup(f"<{tag}{given}/>")
    return Markup(f"<{tag}{given}>{inside}</{tag}>")


def join(*parts: "str | None") -> Markup:
    """Concatenate texts and markup."""
    return Markup(
        "".join(
            part if isinstance(part, Markup) else escape(part, quote=False)
            for part in parts
            if part is not None
        )
    )
