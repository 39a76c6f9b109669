"""Diagrams by Mermaid; the script comes with NiceGUI's package and is copied into the site."""

from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import Directive

_SCRIPT = """
import {{ mermaid }} from "{path}/index.js";
const dark = matchMedia("(prefers-color-scheme: dark)").matches;
const theme = document.body.dataset.theme;
const isDark = theme === "dark" || (theme !== "light" && dark);
mermaid.initialize({{ startOnLoad: false, theme: isDark ? "dark" : "neutral" }});
await mermaid.run({{ querySelector: "pre.mermaid" }});
"""


class Mermaid(Directive):
    """A diagram; without scripts the page shows its source."""

    has_content: ClassVar[bool] = True

    def run(self) -> list[nodes.Node]:
        """Return the diagram's place."""
        source = "\n".join(self.content)
        escaped = source.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
        return [nodes.raw("", f'<pre class="mermaid">{escaped}</pre>', format="html")]


def _add_script(
    app: Any, pagename: str, _template: str, context: dict[str, Any], doctree: Any
) -> None:
    body = context.get("body", "")
    if doctree is not None and 'class="mermaid"' in body:
        depth = pagename.count("/")
        path = "../" * depth + "_static/mermaid" if depth else "./_static/mermaid"
        script = _SCRIPT.format(path=path)
        context["body"] = body + f'<script type="module">{script}</script>'


def _copy_script(app: Any) -> None:
    import nicegui

    folder = Path(nicegui.__file__).parent / "elements" / "mermaid" / "dist"
    target = Path(app.outdir) / "_static" / "mermaid"
    if app.builder.format == "html" and not target.is_dir():
        import shutil

        shutil.copytree(folder, target)


def setup(app: Any) -> dict[str, bool]:
    """Register directive and script."""
    app.add_directive("mermaid", Mermaid)
    app.connect("html-page-context", _add_script)
    app.connect("builder-inited", _copy_script)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
