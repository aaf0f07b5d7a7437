"""HTML from values: everything that is not markup of ours is escaped."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files

from omniservo.reporting.promise_words import CERTIFIED, EXECUTED, REQUIRED


@dataclass(frozen=True)
class Markup:
    """Text that is HTML already."""

    html: str


Cell = str | Markup


def text(value: Cell) -> str:
    """Return a value as HTML; only `Markup` passes unescaped."""
    return value.html if isinstance(value, Markup) else escape(value, quote=True)


def tag(name: str, *content: Cell, **attributes: str) -> Markup:
    """Return an element; ``class_`` gives the attribute class, ``aria_label`` aria-label."""
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value, quote=True)}"'
        for key, value in attributes.items()
    )
    return Markup(f"<{name}{given}>{''.join(text(c) for c in content)}</{name}>")


def joined(parts: Iterable[Cell]) -> Markup:
    """Return parts one after the other."""
    return Markup("\n".join(text(part) for part in parts))


def table(head: Sequence[Cell], rows: Iterable[Sequence[Cell]]) -> Markup:
    """Return a table that scrolls sideways where the page is too narrow; of empty words there is no head."""
    top = tag("tr", *(tag("th", cell, scope="col") for cell in head)) if any(head) else Markup("")
    body = [tag("tr", tag("th", row[0], scope="row"), *(tag("td", cell) for cell in row[1:])) for row in rows]
    return tag("div", tag("table", tag("thead", top), tag("tbody", *body)), class_="scroll", tabindex="0")


def whole(words: str) -> Markup:
    """Return words that stand in one line."""
    return tag("span", words, class_="whole")


def tiles(values: Iterable[tuple[str, str, str]]) -> Markup:
    """Return large numbers side by side: label, value, note."""
    cells = (
        tag("div", tag("dt", label), tag("dd", value), tag("dd", _unparted(note), class_="quiet"))
        for label, value, note in values
    )
    return tag("dl", *cells, class_="tiles")


@dataclass(frozen=True)
class ConstraintCard:
    """One quantity: what is required of it, what was certified of the planned path, what was measured."""

    label: str
    executed: str
    certified: str | None = None
    """None: nothing is proven of it, and nothing was required"""
    asked: str | None = None
    note: str = ""


def constraint_cards(values: Iterable[ConstraintCard]) -> Markup:
    """Return tiles in which each number stands beside the word that says whose it is."""
    return tag("div", *(_constraint_card(value) for value in values), class_="constraints")


def _constraint_card(value: ConstraintCard) -> Markup:
    lines = [(EXECUTED, value.executed), (CERTIFIED, value.certified), (REQUIRED, value.asked)]
    rows = (tag("div", tag("dt", word), tag("dd", said)) for word, said in lines if said is not None)
    note = [tag("p", _unparted(value.note), class_="quiet")] if value.note else []
    return tag("div", tag("p", value.label, class_="label"), tag("dl", *rows), *note)


def _unparted(words: str) -> str:
    """Return words whose lines do not break between a number and its unit."""
    return re.sub(r"(?<=\d) (?=\D)", "\u00a0", words)


def page(title: str, body: Iterable[Cell]) -> str:
    """Return a whole page, which loads nothing and runs nothing."""
    style = (files("omniservo.reporting") / "report.css").read_text(encoding="utf-8")
    head = joined(
        [
            Markup('<meta charset="utf-8">'),
            Markup('<meta name="viewport" content="width=device-width, initial-scale=1">'),
            Markup('<meta name="color-scheme" content="light dark">'),
            tag("title", f"omniservo: {title}"),
            tag("style", Markup(style)),
        ]
    )
    whole = tag("html", tag("head", head), tag("body", tag("main", joined(body))), lang="en")
    return f"<!doctype html>\n{whole.html}\n"


def banner(title: str, summary: str) -> Markup:
    """Return what stands first on a page."""
    brand = tag("p", "omniservo", class_="brand")
    return tag("header", brand, tag("h1", title), tag("p", summary, class_="summary"))


def judged(good: bool, *content: Cell) -> Markup:
    """Return the box that says how it went."""
    return tag("div", *content, class_="verdict good" if good else "verdict bad")


def part(title: str, *content: Markup) -> Markup:
    """Return a section with its title."""
    return tag("section", tag("h2", title), *content)


def inlined(data: bytes, kind: str, alternative: str) -> Markup:
    """Return an image that is part of the page; ``kind`` is as in its MIME type."""
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
    return Markup(f'<img src="{source}" alt="{escape(alternative, quote=True)}">')


def enlargeable(data: bytes, kind: str, alternative: str, size: tuple[float, float]) -> Markup:
    """Return an image that fills the window on a click or Enter, until a click or Escape; without a script.

    The image is the popover of the button around it; ``size`` (width, height) keeps its place on the page.
    """
    name = f"figure-{hashlib.sha256(data).hexdigest()[:12]}"
    shown = inlined(data, kind, alternative).html.replace("<img", f'<img id="{name}" popover', 1)
    return tag(
        "button",
        Markup(shown),
        type="button",
        class_="enlarge",
        popovertarget=name,
        title="enlarge (Escape closes)",
        aria_label=f"enlarge: {alternative}",
        style=f"aspect-ratio: {size[0]:.4g} / {size[1]:.4g}",
    )
