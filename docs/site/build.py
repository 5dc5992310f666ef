"""Build the documentation as a site: gather the pages, generate the reference, run Sphinx.

``make docs``, or ``python docs/site/build.py OUT``. The build needs no network, and a warning is an error. It generates
a page for each command from its options, the list of schemas, and the public names of each package with their
docstrings.
"""

from __future__ import annotations

import importlib
import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from typer.main import get_command

from rotorid._faces import deprecated
from rotorid.cli.app import COMMANDS, app
from rotorid.documents.schemas import SCHEMAS

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
DOCS = ROOT / "docs"
FACES = (
    *("rotorid", "rotorid.benchmarking", "rotorid.data", "rotorid.excitation", "rotorid.exports", "rotorid.fitting"),
    "rotorid.fleets",
    *(
        "rotorid.flights",
        "rotorid.flying",
        "rotorid.identifying",
        "rotorid.loops",
        "rotorid.models",
        "rotorid.planning",
    ),
    *("rotorid.plot", "rotorid.proposing", "rotorid.reduction", "rotorid.results", "rotorid.reviewing"),
    *(
        "rotorid.search",
        "rotorid.settings",
        "rotorid.signal",
        "rotorid.simulation",
        "rotorid.spectral",
        "rotorid.tuning",
        "rotorid.uncertainty",
    ),
    *("rotorid.vehicles", "rotorid.verification"),
)
"""Packages whose public names the reference lists."""

_OUTSIDE = re.compile(r"\[([^\]]+)\]\(((?:\.\./)+(?:src|tests|benchmarks|LICENSE)[^)]*)\)")
_PAGES = re.compile(r"\]\((?:\.\./)*(?:docs/)?site/pages/")
"""A link from another folder to a page that the site has at its top."""

_TOP = ("CHANGELOG.md", "SECURITY.md", "CONTRIBUTING.md")
_TREE = "```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{entries}\n```\n"


def gather(source: Path) -> None:
    """All pages and files of the site in one folder."""
    skipped = shutil.ignore_patterns("site", "*.1")
    shutil.copytree(DOCS, source, ignore=skipped)
    for page in (HERE / "pages").glob("*.md"):
        # In the project they are two folders deeper.
        text = page.read_text(encoding="utf-8").replace("](../../", "](")
        (source / page.name).write_text(text, encoding="utf-8")
    shutil.copy(HERE / "conf.py", source / "conf.py")
    shutil.copytree(HERE / "static", source / "static")
    for name in _TOP:
        text = (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](")
        (source / name).write_text(text, encoding="utf-8")
    for page in source.rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        # Files of the project outside of the site are named without a link.
        text = _OUTSIDE.sub(lambda found: f"{found[1]} (`{found[2].replace('../', '')}`)", text)
        up = "../" * (len(page.relative_to(source).parts) - 1)
        text = re.sub(r"\]\((?:\.\./)*(CHANGELOG|SECURITY|CONTRIBUTING)\.md", rf"]({up}\1.md", text)
        text = re.sub(r"\]\((?:\.\./)+README\.md[^)]*\)", f"]({up}index.md)", text)
        page.write_text(_PAGES.sub(f"]({up}", text), encoding="utf-8")
    commands(source / "commands")
    schemas(source / "schemas.md", source / "schemas")
    names(source / "api")
    (source / "index.md").write_text(index(source), encoding="utf-8")


def commands(folder: Path) -> None:
    """A page for each command, from the one declaration of its options."""
    folder.mkdir()
    group: Any = get_command(app)
    for name in COMMANDS:
        command = group.commands[name]
        lines = [f"# rotorid {name}", "", " ".join((command.help or "").split()), ""]
        lines += ["```", f"rotorid {name} {' '.join(_usage(command))}", "```", ""]
        for heading, options in _panels(command).items():
            lines += [f"## {heading}", "", *(line for one in options for line in _option(one))]
        (folder / f"{name}.md").write_text("\n".join(lines), encoding="utf-8")
    listed = [f"| [`rotorid {name}`]({name}.md) | {_cell(words)} |" for name, words in COMMANDS.items()]
    tree = _TREE.format(caption="Commands", entries="\n".join(COMMANDS))
    text = "# Commands\n\n| command | what it does |\n|---|---|\n" + "\n".join(listed) + f"\n\n{tree}"
    (folder / "index.md").write_text(text, encoding="utf-8")


def _usage(command: Any) -> Iterator[str]:
    yield "[OPTIONS]"
    for one in command.params:
        if one.param_type_name == "argument":
            yield (one.metavar or one.name.upper()) + ("..." if one.nargs == -1 and not one.metavar else "")


def _panels(command: Any) -> dict[str, list[Any]]:
    """Options and arguments of a command, in the groups of its help."""
    panels: dict[str, list[Any]] = {}
    for one in command.params:
        if not getattr(one, "hidden", False):
            kind = "Arguments" if one.param_type_name == "argument" else "Options"
            panels.setdefault(getattr(one, "rich_help_panel", None) or kind, []).append(one)
    return panels


def _option(one: Any) -> Iterator[str]:
    """An option and its help as a definition, which uses the whole width on a phone too."""
    if one.param_type_name == "argument":
        written = f"`{(one.metavar or one.name).upper()}`"
    else:
        taken = f" {one.metavar}" if one.metavar else ""
        written = ", ".join(f"`{word}{taken}`" for word in (*one.opts, *one.secondary_opts))
    unsaid = one.default in (None, False, (), []) or callable(one.default)
    default = "" if unsaid or "[default" in (one.help or "") else f" Default: `{one.default}`."
    yield from (written, f": {_cell(one.help or '')}{default}", "")


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def _first(documented: str | None) -> str:
    """The first paragraph of a docstring."""
    return (documented or "").split("\n\n")[0]


def schemas(page: Path, folder: Path) -> None:
    """Every document with its description, and its schema as a file."""
    rows = []
    for name, kind in SCHEMAS.items():
        rows.append(f"| {{download}}`{name} <schemas/{name}.json>` | {_cell(_first(kind.__doc__))} |")
        json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    head = "# Schemas\n\nJSON schemas of the files that commands write; see [files and schemas](results.md).\n\n"
    head += "| schema | of |\n|---|---|\n"
    page.write_text(head + "\n".join(rows) + "\n", encoding="utf-8")


def names(folder: Path) -> None:
    """The public names of each package."""
    folder.mkdir()
    for face in FACES:
        package = importlib.import_module(face)
        lines = [f"# {face}", "", _cell(_first(package.__doc__)), "", "```{eval-rst}"]
        for name in package.__all__:
            value = getattr(package, name)
            if not getattr(value, "__doc__", None) or not (isinstance(value, type) or callable(value)):
                continue
            kind = "autoclass" if isinstance(value, type) else "autofunction"
            lines.append(f".. {kind}:: {face}.{name}")
            if face != "rotorid" and name in importlib.import_module("rotorid").__all__:
                lines.append("   :no-index:")
            if isinstance(value, type):
                lines.append("   :members:")
            lines.append("")
        lines += ["```", ""]
        if going := deprecated(face):
            lines += ["## Deprecated", "", *(f"- `{name}`: {words}" for name, words in sorted(going.items())), ""]
        (folder / f"{face}.md").write_text("\n".join(lines), encoding="utf-8")
    listed = [f"| [`{face}`]({face}.md) | {_cell(_first(importlib.import_module(face).__doc__))} |" for face in FACES]
    tree = _TREE.format(caption="Packages", entries="\n".join(FACES))
    head = "# Python names\n\n| package | content |\n|---|---|\n"
    (folder / "index.md").write_text(head + "\n".join(listed) + f"\n\n{tree}", encoding="utf-8")


PARTS = {
    "Start here": ("pilot", "developer", "control-engineer", "operator", "researcher", "coming-from"),
    "Tutorials": ("notebooks/first-steps", "notebooks/betaflight-gains", "tutorials/README"),
    "How-to guides": (
        *("what-it-does", "review", "review-loops", "review-noise-motors", "design", "test-inputs", "tune"),
        *("track", "fleet", "lab", "mcp", "simulation", "vehicles", "export", "export-gallery", "randomization"),
        *("forward-flight", "mapping", "python", "bench", "preferences", "adding"),
    ),
    "Explanation": (
        *("method", "motors", "flight", "time-domain", "searches", "controllers", "accuracy", "limits", "tuning-study"),
        *("peers", "papers", "security", "architecture"),
    ),
    "Reference": (
        *("commands/index", "api/index", "models", "results", "papers-values", "schemas", "glossary"),
        *("CHANGELOG", "SECURITY", "CONTRIBUTING"),
    ),
}
"""The menu by purpose: captions and their pages."""


def index(source: Path) -> str:
    """The first page, with the menu."""
    text = (HERE / "index.md").read_text(encoding="utf-8")
    trees = [
        _TREE.format(caption=caption, entries="\n".join(page for page in pages if (source / f"{page}.md").exists()))
        for caption, pages in PARTS.items()
    ]
    return text + "\n" + "\n".join(trees)


def build(out: Path) -> int:
    """Make the site; the exit code of Sphinx."""
    source = out / "source"
    if out.exists():
        shutil.rmtree(out)
    out.mkdir(parents=True)
    gather(source)
    tutorials = sorted(page.stem for page in (source / "tutorials").glob("*.md") if page.stem != "README")
    with (source / "tutorials" / "README.md").open("a", encoding="utf-8") as page:
        page.write("\n" + _TREE.format(caption="Tutorials", entries="\n".join(tutorials)))
    command = [sys.executable, "-m", "sphinx", "-b", "html", "-W", "--keep-going", "-q", "-j", "auto"]
    code = subprocess.call([*command, str(source), str(out / "html")])
    for page in (out / "html").rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        # The theme lacks these for keyboards and screen readers.
        text = text.replace('class="caption" role="heading"', 'class="caption" role="heading" aria-level="2"')
        text = text.replace('<div class="table-wrapper', '<div tabindex="0" class="table-wrapper')
        page.write_text(re.sub(r"<pre>(?=<span)", '<pre tabindex="0">', text), encoding="utf-8")
    return code


def main() -> int:
    """Build the site, and print its place and the time it took."""
    out = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "build" / "site").resolve()
    began_s = time.monotonic()
    code = build(out)
    made = f"{out / 'html' / 'index.html'}" if code == 0 else "no site"
    print(f"{made}, in {time.monotonic() - began_s:.0f} s")
    return code


if __name__ == "__main__":
    sys.exit(main())
