"""From blocks to one HTML file that needs nothing else: template, style, scripts and the published builds inside."""

from __future__ import annotations

import html
import json
from collections.abc import Iterable
from importlib import resources
from importlib.resources.abc import Traversable

from groupstart.report.blocks import packed

SCRIPTS = ("data.js", "colour.js", "scene.js", "plots.js", "program.js", "legend.js", "report.js", "main.js")
THREE_FILES = (
    "three.core.js",
    "three.module.js",
    "OrbitControls.js",
    "LineSegmentsGeometry.js",
    "LineMaterial.js",
    "LineSegments2.js",
)
"""In the order in which each finds those it imports already made."""


def compose(title: str, blocks: Iterable[str]) -> str:
    """The page. blocks: elements as of ``groupstart.report.blocks``; title: plain text."""
    here = resources.files("groupstart.report")
    values = {
        "title": html.escape(title),
        "style": _text(here / "page" / "style.css"),
        "uplot_css": _text(here / "vendor" / "uplot" / "uPlot.min.css"),
        "uplot": _script(_text(here / "vendor" / "uplot" / "uPlot.iife.min.js")),
        "script": _script("\n".join(_text(here / "page" / name) for name in SCRIPTS)),
        "blocks": "".join([*blocks, *_three(here)]),
    }
    page = _text(here / "page" / "page.html")
    for name, value in values.items():
        page = page.replace("{{" + name + "}}", value, 1)
    return page


def _three(here: Traversable) -> Iterable[str]:
    listed = []
    for number, name in enumerate(THREE_FILES):
        listed.append({"id": f"three-{number}", "file": name})
        data = packed(_text(here / "vendor" / "three" / name).encode("utf-8"))
        yield f'<script type="application/octet-stream" id="three-{number}">{data}</script>\n'
    yield f'<script type="application/json" id="three-files">{json.dumps(listed)}</script>\n'
    licences = [("three.js", "three"), ("uPlot", "uplot")]
    words = "\n\n".join(f"{name}\n{_text(here / 'vendor' / folder / 'LICENSE')}" for name, folder in licences)
    yield f'<script type="text/plain" id="licences">{html.escape(words)}</script>\n'


def _script(text: str) -> str:
    """A script that no text inside can end."""
    return text.replace("</script", "<\\/script")


def _text(file: Traversable) -> str:
    return file.read_text(encoding="utf-8")
