"""Version, search and colours of code for the documents in a browser: a hook of mkdocs.

The pages work from a disk, where a browser lets no script fetch a file. So the search index is written as a script.
"""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files
from pygments.formatters import HtmlFormatter

_STYLE = "default"
_INDEX = "search/search_index.json"


def on_config(config: Any, **_: Any) -> Any:
    """Show the version of the installed package above the menu."""
    config.extra["version"] = f"version {version('aspectgraph')}"
    return config


def on_files(files: Files, *, config: Any, **_: Any) -> Files:
    """Add the style sheet of highlighted code."""
    css = HtmlFormatter(style=_STYLE).get_style_defs(".highlight")
    files.append(File.generated(config, "highlight.css", content=css))
    return files


def on_post_build(config: Any, **_: Any) -> None:
    """Write the search index as a script."""
    path = Path(config.site_dir) / _INDEX
    entries = json.loads(path.read_text(encoding="utf-8"))["docs"]
    script = f"window.searchIndex = {json.dumps(entries, ensure_ascii=False)};\n"
    path.with_suffix(".js").write_text(script, encoding="utf-8")
    path.unlink()
